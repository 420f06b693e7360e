//! Random numbers for tests, and what they are held against.

use lumicache::math::{PI, Vec2, Vec3};

/// SplitMix64: the test's own generator, so that no test leans on the code it tests.
pub struct Rng(pub u64);

impl Rng {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1), 24 bits.
    pub fn next(&mut self) -> f32 {
        (self.bits() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in [0, 1)².
    pub fn vec2(&mut self) -> Vec2 {
        Vec2::new(self.next(), self.next())
    }

    /// Uniform in the cube [-1, 1]³.
    pub fn cube(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    /// A uniform direction of the sphere.
    pub fn direction(&mut self) -> Vec3 {
        let z = 1.0 - 2.0 * self.next();
        let azimuth = 2.0 * PI * self.next();
        let radius = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(radius * azimuth.cos(), radius * azimuth.sin(), z)
    }
}

/// Upper tail of the chi-square distribution by the Wilson-Hilferty cube root: the z value of a
/// statistic.
pub fn chi2_z(statistic: f64, dof: f64) -> f64 {
    ((statistic / dof).cbrt() - (1.0 - 2.0 / (9.0 * dof))) / (2.0 / (9.0 * dof)).sqrt()
}

/// Compares counts with expectations, cells with an expectation below 5 pooled. Fails above z =
/// 4.5: a false alarm in 300 000 tests.
pub fn assert_chi2(observed: &[f64], expected: &[f64], what: &str) {
    let (mut statistic, mut dof, mut pooled) = (0.0, -1.0, (0.0, 0.0));
    for (&o, &e) in observed.iter().zip(expected) {
        if e < 5.0 {
            pooled = (pooled.0 + o, pooled.1 + e);
        } else {
            statistic += (o - e) * (o - e) / e;
            dof += 1.0;
        }
    }
    if pooled.1 >= 5.0 {
        statistic += (pooled.0 - pooled.1) * (pooled.0 - pooled.1) / pooled.1;
        dof += 1.0;
    } else {
        assert!(pooled.0 <= 25.0, "{what}: {} samples where {} are expected", pooled.0, pooled.1);
    }
    let z = chi2_z(statistic, dof);
    assert!(z < 4.5, "{what}: chi-square {statistic:.0} with {dof} degrees of freedom, z = {z:.1}");
}

/// Mean and standard error of the mean.
pub struct Mean {
    pub count: f64,
    pub sum: f64,
    pub squares: f64,
}

impl Mean {
    pub fn new() -> Self {
        Self { count: 0.0, sum: 0.0, squares: 0.0 }
    }

    pub fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    pub fn mean(&self) -> f64 {
        self.sum / self.count
    }

    pub fn variance(&self) -> f64 {
        (self.squares / self.count - self.mean() * self.mean()).max(0.0)
    }

    pub fn error(&self) -> f64 {
        (self.variance() / self.count).sqrt()
    }
}

pub fn assert_mean(mean: &Mean, expected: f64, what: &str) {
    let sigma = mean.error().max(1e-6 * expected.abs()).max(1e-12);
    let off = (mean.mean() - expected) / sigma;
    assert!(off.abs() < 4.5, "{what}: {} instead of {expected}, {off:.1} sigma", mean.mean());
}
