//! Where records are made: rounds over the points of a level, gathers, refinement, and the one
//! driver of all levels.

mod points;
mod gatherer;
mod rounds;
mod locate;
mod weber;
mod refinement;
mod radiosity;
mod levels;
mod late;

pub use levels::{FillPlan, FillReport, Towards, World};
pub use points::{Appearances, FillStats, LevelPoints, ShadingPoint, VIEWED, scattered};
pub use radiosity::{Casting, Found, Share, Transfer};
