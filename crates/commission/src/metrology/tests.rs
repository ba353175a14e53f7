//! Touches on benches with screws that the fit does not assume.

use rig_model::random::{Stream, normal_at};

use super::*;

/// What is true of a bench.
pub(super) struct Truth {
    pub(super) geometry: [f64; 4],
    pub(super) screw: Screw,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Screw {
    None,
    /// Amplitude, pitch, mm; phase.
    Periodic(f64, f64, f64),
    /// Random at places of this distance, straight between them: standard deviation, mm, and seed.
    Broken(f64, f64, u64),
}

pub(super) const NOISE: TouchNoise = TouchNoise { height_mm: 0.001, tilt_deg: 0.01 };
const TILTS: [f64; 7] = [-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0];

impl Screw {
    pub(super) fn error(self, at_mm: f64) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Periodic(amplitude, pitch, phase) => {
                amplitude * (std::f64::consts::TAU * at_mm / pitch + phase).sin()
            }
            Self::Broken(sigma, length, seed) => {
                let cell = (at_mm / length).floor();
                #[expect(clippy::cast_possible_truncation, reason = "a travel has few cells")]
                let draw =
                    |cell: f64| sigma * normal_at(seed, [7, (cell as i64).cast_unsigned(), 0]);
                let part = at_mm / length - cell;
                (1.0 - part) * draw(cell) + part * draw(cell + 1.0)
            }
        }
    }
}

/// Touches of a bench, three at each tilt.
pub(super) fn touches(truth: &Truth, blocks_mm: &[f64], chance: &mut Stream) -> Vec<BlockTouch> {
    touches_at(truth, &TILTS.map(|tilt| [tilt; 3]).concat(), blocks_mm, chance)
}

/// Touches of a bench: the height at which the ball meets the plane, found without the formula of the fit.
pub(super) fn touches_at(
    truth: &Truth,
    tilts_deg: &[f64],
    blocks_mm: &[f64],
    chance: &mut Stream,
) -> Vec<BlockTouch> {
    let [surface, from_axis, beside, zero] = truth.geometry;
    let mut all = Vec::new();
    for raised_mm in blocks_mm {
        for &tilt_deg in tilts_deg {
            let at_deg = tilt_deg + NOISE.tilt_deg * chance.normal() + zero;
            let (sin, cos) = at_deg.to_radians().sin_cos();
            // The centre of the ball has the distance D + b from the axis along the normal (sin, cos).
            let centre = (from_axis + raised_mm - beside * sin) / cos;
            let true_mm = surface + centre - from_axis;
            // The drive counts the true height plus the error of its screw.
            let height_mm =
                true_mm + truth.screw.error(true_mm) + NOISE.height_mm * chance.normal();
            all.push(BlockTouch { tilt_deg, height_mm, raised_mm: *raised_mm });
        }
    }
    all
}

fn found(fitted: &BlockGeometry) -> [f64; 4] {
    [fitted.surface_mm, fitted.surface_and_radius_mm, fitted.probe_beside_pivot_mm, fitted.zero_deg]
}

/// Fits many benches; gives root mean squares and coverages of 95 % intervals, for each unknown.
fn campaign(blocks_mm: &[f64], screw: impl Fn(u64, &mut Stream) -> Screw) -> [(f64, f64); 4] {
    let benches = 60;
    let mut squares = [0.0; 4];
    let mut inside = [0.0; 4];
    for seed in 0..benches {
        let chance = &mut Stream::new(seed, 3);
        let around = |middle: f64, width: f64, chance: &mut Stream| {
            middle + width * (2.0 * chance.uniform() - 1.0)
        };
        let geometry = [
            around(10.0, 0.5, chance),
            around(4.5, 1.0, chance),
            around(0.3, 1.0, chance),
            around(0.0, 1.0, chance),
        ];
        let truth = Truth { geometry, screw: screw(seed, chance) };
        let fitted = fit(&touches(&truth, blocks_mm, chance), &NOISE, &[]).unwrap();
        for (k, (found, sigma)) in found(&fitted).into_iter().zip(fitted.sigmas()).enumerate() {
            // The error of the screw at the surface is a part of the height of the surface.
            let expected = geometry[k] + if k == 0 { truth.screw.error(geometry[0]) } else { 0.0 };
            squares[k] += (found - expected).powi(2) / benches as f64;
            inside[k] +=
                f64::from(u8::from((found - expected).abs() < 1.96 * sigma)) / benches as f64;
        }
    }
    std::array::from_fn(|k| (squares[k].sqrt(), inside[k]))
}

#[test]
fn without_an_error_of_the_screw_the_geometry_is_found_to_micrometres() {
    let [surface, from_axis, beside, zero] = campaign(&[0.0], |_, _| Screw::None);
    let all = format!("{surface:?} {from_axis:?} {beside:?} {zero:?}");
    assert!(surface.0 < 0.002 && from_axis.0 < 0.008 && beside.0 < 0.015 && zero.0 < 0.15, "{all}");
    assert!([surface, from_axis, beside, zero].iter().all(|found| found.1 > 0.9), "{all}");
}

#[test]
fn stated_uncertainties_cover_the_truth_for_screws_that_the_fit_does_not_assume() {
    let periodic = |_: u64, chance: &mut Stream| {
        Screw::Periodic(0.01, 2.0, std::f64::consts::TAU * chance.uniform())
    };
    let broken = |seed: u64, _: &mut Stream| Screw::Broken(0.014, 0.3, seed);
    for blocks in [&[0.0][..], &[0.0, 10.0]] {
        for (name, found) in
            [("periodic", campaign(blocks, periodic)), ("broken", campaign(blocks, broken))]
        {
            println!("{name}, {} blocks: {found:?}", blocks.len());
            for (k, (_, covered)) in found.iter().enumerate().skip(1) {
                assert!(
                    *covered >= 0.85,
                    "{name}, {} blocks, unknown {k}: {found:?}",
                    blocks.len()
                );
            }
        }
    }
    // A second block finds the zero of the rotary stage.
    let (one, two) = (campaign(&[0.0], broken)[3].0, campaign(&[0.0, 10.0], broken)[3].0);
    assert!(4.0 * two < one, "{one}° on one block, {two}° on two");
}

#[test]
fn the_map_of_the_screw_makes_a_depth_less_wrong() {
    let (mut raw, mut mapped) = (0.0, 0.0);
    for seed in 0..20 {
        let chance = &mut Stream::new(seed, 9);
        let screw = Screw::Periodic(0.01, 2.0, std::f64::consts::TAU * chance.uniform());
        let truth = Truth { geometry: [10.0, 4.5, 0.3, 0.1], screw };
        let ends = [10.2, 9.7 + 0.8];
        let fitted = fit(&touches(&truth, &[0.0], chance), &NOISE, &ends).unwrap();
        let way = |error: [f64; 2]| error[1] - error[0];
        let is = way(ends.map(|end| screw.error(end)));
        let map = way([fitted.screw.errors[0].error_mm, fitted.screw.errors[1].error_mm]);
        raw += is.powi(2);
        mapped += (is - map).powi(2);
    }
    assert!(mapped < 0.5 * raw, "{mapped} of {raw} mm²");
}

/// Tilts whose heights are a tenth of a millimetre apart, as in `config/protocols/screw.toml`.
pub(super) fn even_tilts() -> Vec<f64> {
    let tilt = |index: i32| {
        let secant = 1.0 + 0.023 * f64::from(index.abs());
        f64::from(index.signum()) * secant.recip().acos().to_degrees()
    };
    (-18..=18).map(tilt).collect()
}

/// Draws the screw of a bench.
type Draw = fn(u64, &mut Stream) -> Screw;

#[test]
fn depths_by_the_map_of_two_blocks_are_as_wrong_as_stated() {
    let tilts = even_tilts();
    let screws: [(&str, Draw); 2] = [
        ("periodic", |_, chance| {
            Screw::Periodic(0.01, 2.0, std::f64::consts::TAU * chance.uniform())
        }),
        ("broken", |seed, _| Screw::Broken(0.014, 0.3, seed)),
    ];
    for (name, screw) in screws {
        let (mut raw, mut mapped, mut stated, mut inside, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for seed in 0..20 {
            let chance = &mut Stream::new(seed, 11);
            let truth = Truth { geometry: [10.0, 4.5, 0.3, 0.1], screw: screw(seed, chance) };
            let all = touches_at(&truth, &tilts, &[0.0, -0.7], chance);
            // Half a millimetre below surfaces that lie 0.1 mm apart.
            let ends: Vec<f64> = (0..22).map(|k| 9.5 + 0.1 * f64::from(k)).collect();
            let map = fit(&all, &NOISE, &ends).unwrap().screw;
            for low in 0..ends.len() - 5 {
                let high = low + 5;
                let is = truth.screw.error(ends[high]) - truth.screw.error(ends[low]);
                let found = map.errors[high].error_mm - map.errors[low].error_mm;
                let covariance = |a: usize, b: usize| map.covariance_mm2[a][b];
                let variance =
                    covariance(high, high) + covariance(low, low) - 2.0 * covariance(high, low);
                raw += is.powi(2);
                mapped += (found - is).powi(2);
                stated += variance;
                inside += f64::from(u8::from((found - is).abs() < 1.96 * variance.sqrt()));
                count += 1.0;
            }
        }
        let [raw, mapped, stated] = [raw, mapped, stated].map(|sum| (sum / count).sqrt());
        let inside = inside / count;
        println!(
            "{name}: {raw:.4} mm, by the map {mapped:.4}, stated {stated:.4}, within {inside:.3}"
        );
        assert!(mapped < 0.5 * raw, "{name}: {mapped} of {raw} mm");
        assert!(inside > 0.85 && mapped < 1.3 * stated, "{name}: {inside}, {mapped} {stated}");
    }
}

#[test]
fn a_touch_that_is_off_is_named() {
    for seed in 0..20 {
        let chance = &mut Stream::new(seed, 5);
        let screw = Screw::Broken(0.014, 0.3, seed);
        let truth = Truth { geometry: [10.0, 4.5, 0.3, 0.2], screw };
        let mut all = touches(&truth, &[0.0], chance);
        assert!(fit(&all, &NOISE, &[]).is_ok(), "seed {seed}");
        let wrong = usize::try_from(seed).unwrap();
        all[wrong].height_mm += 0.5;
        let refused = fit(&all, &NOISE, &[]).unwrap_err();
        let NoGeometry::Scattered { tilt_deg, height_mm, .. } = refused else {
            panic!("seed {seed}: {refused:?}")
        };
        assert_eq!(
            (tilt_deg, height_mm),
            (all[wrong].tilt_deg, all[wrong].height_mm),
            "seed {seed}"
        );
    }
}

#[test]
fn touches_that_cannot_give_a_geometry_are_refused() {
    let truth = Truth { geometry: [10.0, 4.5, 0.3, 0.0], screw: Screw::None };
    let all = touches(&truth, &[0.0], &mut Stream::new(1, 1));
    let few: Vec<_> = all.iter().copied().filter(|touch| touch.tilt_deg.abs() < 20.0).collect();
    assert!(matches!(fit(&few, &NOISE, &[]), Err(NoGeometry::TooFewTilts { found: 3, .. })));
    let steep: Vec<_> =
        (0..6).map(|i| BlockTouch { tilt_deg: 5.0 * f64::from(i), ..all[0] }).collect();
    assert!(matches!(fit(&steep, &NOISE, &[]), Err(NoGeometry::TooNarrow { .. })));
    let mut broken = all.clone();
    broken[3].height_mm = f64::NAN;
    assert_eq!(fit(&broken, &NOISE, &[]), Err(NoGeometry::NoSolution));
    assert_eq!(fit(&[], &NOISE, &[]), Err(NoGeometry::TooFewTilts { found: 0, least: 5 }));
}
