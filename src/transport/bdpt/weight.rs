//! Multiple importance sampling over all ways to make one path.

/// The densities of a vertex, both per area.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// With which a path from the light makes it.
    pub from_light: f64,
    /// With which a path from the camera makes it.
    pub from_camera: f64,
    /// A path may be joined here: it was not scattered into a single direction.
    pub open: bool,
}

/// The densities of a path's end on a light, per area or, at infinity, per steradian.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LightDensity {
    /// Of a camera path that goes on and hits it: 0 for a light without extent.
    pub hit: f64,
    /// Of sampling the lights at the next vertex.
    pub sampled: f64,
    /// Of the start of a light path.
    pub emitted: f64,
}

/// The weight of one way to make a path by the power heuristic with exponent 2 [Veach97, Eq. 9.13,
/// Sec. 10.2].
///
/// The path has the vertices x₀ on the light, x₁ ... x_k, and x_k at the camera; `inner` holds the
/// densities of x₁ ... x_k. The strategy s makes s vertices from the light and the others from the
/// camera and joins x_{s-1} with x_s. With the densities → from the light and ← from the camera,
///
/// ```text
/// p_s = p(x₀) Π_{1≤i<s} →p(x_i) Π_{s≤i<k, i≥1} ←p(x_i)
/// ```
///
/// where p(x₀) is the density of being hit for s = 0, of light sampling at x₁ for s = 1, and of
/// emission from s = 2 on. Only quotients are formed.
pub(super) fn weight(light: &LightDensity, inner: &[Density], strategy: usize) -> f64 {
    let last = inner.len();
    let head = |s: usize| match s {
        0 => light.hit,
        1 => light.sampled,
        _ => light.emitted,
    };
    let open = |i: usize| i == 0 || inner[i - 1].open;
    let possible = |s: usize| s == 0 || (open(s - 1) && open(s));
    let own = head(strategy);
    let mut sum = 1.0;
    // Strategies with more vertices from the light, then with fewer.
    let mut ratio = 1.0;
    for s in strategy + 1..=last {
        if s >= 2 {
            let v = &inner[s - 2];
            ratio *= v.from_light / v.from_camera;
        }
        if ratio == 0.0 {
            break;
        }
        if possible(s) {
            let quotient = ratio * head(s) / own;
            sum += quotient * quotient;
        }
    }
    ratio = 1.0;
    for s in (0..strategy).rev() {
        if s >= 1 {
            let v = &inner[s - 1];
            ratio *= v.from_camera / v.from_light;
        }
        if ratio == 0.0 {
            break;
        }
        if possible(s) {
            let quotient = ratio * head(s) / own;
            sum += quotient * quotient;
        }
    }
    if sum.is_nan() { 0.0 } else { 1.0 / sum }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Rng;

    #[test]
    fn weights_of_all_strategies_sum_to_one() {
        let mut rng = Rng::new(1);
        for round in 0..2000 {
            let k = 1 + (rng.next_u64() % 12) as usize;
            let density = |rng: &mut Rng| 10f64.powf(8.0 * f64::from(rng.next_f32()) - 4.0);
            let mut inner: Vec<_> = (0..k)
                .map(|_| Density {
                    from_light: density(&mut rng),
                    from_camera: density(&mut rng),
                    open: rng.next_f32() < 0.7,
                })
                .collect();
            inner[k - 1].open = true;
            let extent = if round % 3 == 0 { 0.0 } else { density(&mut rng) };
            let light = LightDensity {
                hit: extent,
                sampled: density(&mut rng),
                emitted: density(&mut rng),
            };
            let open = |i: usize| i == 0 || inner[i - 1].open;
            let possible: Vec<_> = (0..=k)
                .filter(|&s| if s == 0 { extent > 0.0 } else { open(s - 1) && open(s) })
                .collect();
            let sum: f64 = possible.iter().map(|&s| weight(&light, &inner, s)).sum();
            assert!(possible.is_empty() || (sum - 1.0).abs() < 1e-9, "{sum} {inner:?}");
        }
    }

    #[test]
    fn the_only_way_has_all_the_weight() {
        // A caustic of a point light: behind a mirror at x₁, seen at x₂, nothing but a light path
        // makes it.
        let inner = [(false, 1.0), (true, 2.0), (true, 1.0)].map(|(open, p)| Density {
            from_light: p,
            from_camera: 3.0,
            open,
        });
        let light = LightDensity { hit: 0.0, sampled: 1.0, emitted: 0.5 };
        assert_eq!(weight(&light, &inner, 3), 1.0);
    }

    #[test]
    fn a_known_path_has_its_known_weights() {
        // One surface: densities 2 of hitting the lamp, 3 of sampling it, 5 · 7 against 11 of the
        // light path.
        let inner = [
            Density { from_light: 7.0, from_camera: 11.0, open: true },
            Density { from_light: 1.0, from_camera: 1.0, open: true },
        ];
        let light = LightDensity { hit: 2.0, sampled: 3.0, emitted: 5.0 };
        let p = [2.0 * 11.0, 3.0 * 11.0, 5.0 * 7.0_f64];
        let sum: f64 = p.iter().map(|p| p * p).sum();
        for (s, p) in p.iter().enumerate() {
            assert!((weight(&light, &inner, s) - p * p / sum).abs() < 1e-12, "{s}");
        }
    }
}
