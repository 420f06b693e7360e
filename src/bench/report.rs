//! The outcome of an experiment: a row for each scheme and number of records.

use serde::Serialize;

/// The columns of `report.csv`.
const COLUMNS: [&str; 14] = [
    "preset",
    "wanted",
    "records",
    "equal",
    "error",
    "passes",
    "seconds",
    "uncovered",
    "rmse",
    "relmse",
    "own_rmse",
    "own_relmse",
    "mape",
    "mean_ratio",
];

/// One scheme with one number of records.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The preset, as the plan names it.
    pub preset: String,
    /// Wanted number of records.
    pub wanted: usize,
    /// The nearest one that was found.
    pub records: usize,
    /// It is within 5 %.
    pub equal: bool,
    /// The allowed error that gives this number, all else being scaled with it as
    /// [`crate::cache::Scheme::scale_error`] does.
    pub error: f32,
    /// Passes of refinement.
    pub passes: u32,
    /// Wall seconds of the fill.
    pub seconds: f64,
    /// Shading points at which no record was valid; light is gathered there.
    pub uncovered: usize,
    /// Root of the mean squared error of the irradiance.
    pub rmse: f64,
    /// Mean of (x - r)²/(r² + 0.01).
    pub relmse: f64,
    /// `rmse` less the noise of the reference, which is in it squared; `None` where that is not
    /// known.
    pub own_rmse: Option<f64>,
    /// `relmse` less that of the reference itself.
    pub own_relmse: Option<f64>,
    /// Mean of |x - r|/(|r| + 0.01).
    pub mape: f64,
    /// Sum of the irradiance over that of the reference.
    pub mean_ratio: Option<f64>,
    /// The picture of its irradiance, in the folder of the report.
    pub picture: String,
    /// Its difference to the reference, fourfold.
    pub difference: String,
}

/// The outcome.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene.
    pub title: String,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Shading points.
    pub points: usize,
    /// Rays per record.
    pub rays: u32,
    /// Rays per pixel of the reference, 0 where it was read.
    pub reference_rays: u32,
    /// relMSE of the reference itself; every row's contains it. `None` where it is not known.
    pub noise: Option<f64>,
    /// RMSE of the reference itself.
    pub noise_rmse: Option<f64>,
    /// Scheme by scheme.
    pub rows: Vec<Row>,
}

impl Report {
    /// The rows as comma-separated values with a header.
    pub fn csv(&self) -> String {
        let optional = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.6e}"));
        let mut lines = vec![COLUMNS.map(str::to_owned)];
        lines.extend(self.rows.iter().map(|r| {
            [
                r.preset.clone(),
                r.wanted.to_string(),
                r.records.to_string(),
                r.equal.to_string(),
                r.error.to_string(),
                r.passes.to_string(),
                format!("{:.3}", r.seconds),
                r.uncovered.to_string(),
                format!("{:.6e}", r.rmse),
                format!("{:.6e}", r.relmse),
                optional(r.own_rmse),
                optional(r.own_relmse),
                format!("{:.6e}", r.mape),
                r.mean_ratio.map_or_else(String::new, |m| format!("{m:.6}")),
            ]
        }));
        let mut writer = csv::Writer::from_writer(Vec::new());
        lines.iter().for_each(|l| writer.write_record(l).expect("lines of one length in memory"));
        let bytes = writer.into_inner().expect("a vector takes every byte");
        String::from_utf8(bytes).expect("the fields are text")
    }

    /// The rows as a table for people.
    pub fn text(&self) -> String {
        let width = self.rows.iter().map(|r| r.preset.len()).max().unwrap_or(0).max(16) + 2;
        let mut text = format!(
            "{:<width$}{:>8}{:>9}{:>10}{:>12}{:>12}{:>12}{:>12}{:>9}\n",
            "preset",
            "wanted",
            "records",
            "error",
            "rmse",
            "relmse",
            "own rmse",
            "own relmse",
            "mean"
        );
        let optional = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.4e}"));
        for r in &self.rows {
            let mean = r.mean_ratio.map_or_else(|| "-".to_owned(), |m| format!("{m:.4}"));
            let mark = if r.equal { ' ' } else { '*' };
            text += &format!(
                "{:<width$}{:>8}{:>8}{mark}{:>10.3e}{:>12.4e}{:>12.4e}{:>12}{:>12}{mean:>9}\n",
                r.preset,
                r.wanted,
                r.records,
                r.error,
                r.rmse,
                r.relmse,
                optional(r.own_rmse),
                optional(r.own_relmse)
            );
        }
        if let Some(noise) = self.noise {
            text += &format!("relMSE of the reference itself: {noise:.2e}");
            text += "; own errors are without the reference's\n";
        }
        if self.rows.iter().any(|r| !r.equal) {
            text += "* more than 5 % from the wanted number: no error that was tried gives it\n";
        }
        text
    }
}
