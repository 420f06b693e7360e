//! Where records are made: rounds over the points of a level, gathers, refinement, and the one
//! driver of all levels.

mod points;
mod world;
mod gatherer;
mod rounds;
mod locate;
mod weber;
mod refinement;
mod radiosity;
mod levels;
mod late;

pub use levels::FillReport;
pub use points::{Appearances, FillStats, LevelPoints, ShadingPoint, VIEWED, scattered};
pub use world::{Casting, FillPlan, Found, Share, Towards, Transfer, World};
