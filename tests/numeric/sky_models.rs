//! Skies against their standards, and their text.

use lumicache::light::{Sky, SkyKind, SunKind};
use lumicache::math::{Color, Vec3};

#[test]
fn the_overcast_sky_is_three_times_as_bright_at_the_zenith() {
    let sky = Sky::new(SkyKind::Overcast);
    let map = sky.environment(1.0);
    let up = map.radiance(Vec3::Y).x;
    for degrees in [1.0f32, 10.0, 30.0, 60.0, 89.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let expected = up * (1.0 + 2.0 * sin) / 3.0;
        assert!(
            (map.radiance(Vec3::new(cos, sin, 0.0)).x / expected - 1.0).abs() < 1e-3,
            "{degrees}"
        );
    }
    // E = 7/9 π L_z, and 300 + 21000 sin 45°.
    assert!(
        (7.0 / 9.0 * std::f64::consts::PI * sky.zenith_luminance() / 15_149.24 - 1.0).abs() < 1e-6
    );
    assert!((f64::from(up) / sky.zenith_luminance() - 1.0).abs() < 1e-4);
}

#[test]
fn general_skies_agree_with_the_standard() {
    // At the zenith with the sun there, every factor of the clear sky is known.
    let clear = Sky { elevation: 90.0, ..Sky::new(SkyKind::General(12)) };
    let expected = (1.0 - (-0.32f64).exp())
        * (1.0 + 10.0 * (1.0 - (-1.5 * std::f64::consts::PI).exp()) + 0.45);
    assert!((clear.relative_luminance(1.0, 0.0) / expected - 1.0).abs() < 1e-12);
    // At right angles to the sun the indicatrix is 1; type 5 is uniform; type 1 is overcast by
    // another formula.
    assert!(
        (clear.relative_luminance(1.0, std::f64::consts::FRAC_PI_2) - (1.0 - (-0.32f64).exp()))
            .abs()
            < 1e-12
    );
    let uniform = Sky { illuminance: Some(1000.0), ..Sky::new(SkyKind::General(5)) };
    assert!((uniform.zenith_luminance() * std::f64::consts::PI / 1000.0 - 1.0).abs() < 1e-9);
    let first = Sky::new(SkyKind::General(1));
    let ratio = first.relative_luminance(1.0, 0.5) / first.relative_luminance(0.0, 0.5);
    assert!((ratio - 3.0).abs() < 0.02, "{ratio}");
}

#[test]
fn the_sun_dims_towards_the_horizon_and_in_haze() {
    let at = |elevation, turbidity| {
        Sky { elevation, turbidity, ..Sky::new(SkyKind::General(12)) }.sun_illuminance()
    };
    assert!((at(90.0, 3.0) / 99_240.0 - 1.0).abs() < 2e-3, "{}", at(90.0, 3.0));
    assert!(
        at(60.0, 3.0) > at(20.0, 3.0)
            && at(20.0, 3.0) > at(5.0, 3.0)
            && at(45.0, 2.0) > at(45.0, 6.0)
    );
}

#[test]
fn directions_are_those_of_the_compass() {
    let at = |azimuth, elevation| {
        Sky { azimuth, elevation, ..Sky::new(SkyKind::Overcast) }.sun_direction()
    };
    assert!(
        (at(0.0, 1e-4) - Vec3::NEG_Z).length() < 1e-5 && (at(90.0, 1e-4) - Vec3::X).length() < 1e-5
    );
    assert!((at(10.0, 90.0) - Vec3::Y).length() < 1e-5);
}

#[test]
fn text_is_read_and_mistakes_are_named() {
    let sky = Sky::parse("clear,azimuth=120, elevation=30,sun=direction,turbidity=4,ground=0.1/0.2/0.05,color=0.7/0.9/1.4")
        .unwrap();
    assert_eq!(
        (sky.kind, sky.azimuth, sky.elevation, sky.sun),
        (SkyKind::General(12), 120.0, 30.0, SunKind::Direction)
    );
    assert_eq!((sky.turbidity, sky.ground), (4.0, Color::new(0.1, 0.2, 0.05)));
    assert_eq!(Sky::parse("cie7").unwrap().sun, SunKind::Disc);
    assert_eq!(Sky::parse("overcast,illuminance=10000").unwrap().sky_illuminance(), 10_000.0);
    for (text, expected) in [
        ("cloudy", "\"cloudy\" is no sky"),
        ("cie16", "\"cie16\" is no sky"),
        ("clear,elevation", "\"elevation\": expected KEY=VALUE"),
        ("clear,elevation=-3", "elevation=-3: expected a number from 0.1 to 90"),
        ("clear,elevation=nan", "elevation=nan"),
        ("clear,ground=2", "ground=2: expected"),
        ("clear,ground=1/2", "ground=1/2: expected"),
        ("clear,color=0", "without light"),
        ("clear,sun=moon", "sun=moon"),
        ("clear,lever=1", "\"lever\" is unknown"),
    ] {
        let error = Sky::parse(text).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
