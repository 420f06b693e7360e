//! The coefficients of a lobe: what coefficients of incident radiance are multiplied with.

/// Coefficients of a lobe times the cosine, in the local frame of a shading point.
#[derive(Clone, Debug, Default)]
pub struct LobeCoefficients {
    /// Bands in use.
    pub order: usize,
    /// Red, green, blue; each as many as the basis has functions.
    pub values: Vec<f32>,
    /// The same in the frame of a record, with what the cosine becomes in a fourth run.
    rotated: Vec<f32>,
}

impl LobeCoefficients {
    /// Rotates all runs, and `cosine` as a fourth, by `rotate`. `spill` is the number of bands by
    /// which the order may grow. The runs are no longer than that order needs.
    pub fn rotate(&mut self, cosine: &[f32], spill: usize, rotate: impl Fn(&mut [f32])) {
        let count = (self.order + spill).pow(2).min(cosine.len());
        self.rotated.clear();
        for run in runs(&self.values).into_iter().chain([cosine]) {
            self.rotated.extend_from_slice(&run[..count]);
        }
        self.rotated.chunks_exact_mut(count).for_each(rotate);
    }

    /// The runs of the lobe as a record needs them: in the frame of the point, or in that of the
    /// record if the lobe was turned.
    pub fn used(&self, turned: bool) -> [&[f32]; 3] {
        if turned {
            self.rotated().0
        } else {
            runs(&self.values).map(|run| &run[..run.len().min(self.order * self.order)])
        }
    }

    /// The rotated runs of the lobe, and that of the cosine.
    pub fn rotated(&self) -> ([&[f32]; 3], &[f32]) {
        let (lobe, cosine) = self.rotated.split_at(self.rotated.len() / 4 * 3);
        (runs(lobe), cosine)
    }
}

/// The three runs of coefficients in `c`.
fn runs(c: &[f32]) -> [&[f32]; 3] {
    let count = c.len() / 3;
    [&c[..count], &c[count..2 * count], &c[2 * count..]]
}
