use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rig_contact::{Contact, ContactLaw, Direction, Models, Pose, SensorDescription, Tier, Tissue};

use super::*;

const SAMPLES_MPA: [f64; 5] = [0.045, 0.104, 0.235, 0.320, 0.649];
const HELD: Depth = Depth::Indentation { along_probe_mm: 0.5 };

/// A truth by the reference model.
#[derive(Clone, Copy)]
struct Truth {
    arm_mm: f64,
    friction: Friction,
    slips_beyond_deg: f64,
    depth: Depth,
    /// Factors of the stiffness of sample 3 at rising angles.
    third: [f64; 4],
}

const MATCHED: Truth = Truth {
    arm_mm: 8.0,
    friction: Friction::Sticking,
    slips_beyond_deg: 90.0,
    depth: HELD,
    third: [1.0; 4],
};

const ANGLES_DEG: [f64; 4] = [0.0, 15.0, 30.0, 45.0];

impl Truth {
    /// Main touches, with a scatter of two percent of stiffness that has no pattern.
    fn touches(&self, angles_deg: &[f64]) -> Vec<PosedTouch> {
        let design = SensorDesign { arm_mm: self.arm_mm, ..SensorDesign::reference() };
        let models = Models::new(&Sensor::new(design).unwrap(), ContactLaw::Sneddon);
        let mut touches = Vec::new();
        let mut draw: u32 = 7;
        for (sample, young_mpa) in SAMPLES_MPA.into_iter().enumerate() {
            for direction in Direction::ALL {
                for (index, &angle_deg) in angles_deg.iter().enumerate() {
                    let pose = Pose::leaning(direction, angle_deg.to_radians()).unwrap();
                    let slips = angle_deg > self.slips_beyond_deg;
                    let friction = if slips { Friction::Frictionless } else { self.friction };
                    let law = ContactLaw::Sneddon;
                    let contact = Contact { pose, depth: self.depth, law, friction };
                    draw = draw.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let even = f64::from(draw >> 8) / f64::from(1_u32 << 24) - 0.5;
                    let of_sample = if sample == 2 { self.third[index] } else { 1.0 };
                    let young_mpa = young_mpa * of_sample * (1.0 + 0.07 * even);
                    let tissue = Tissue::soft(young_mpa).unwrap();
                    let found = models.predict(Tier::Reference, &tissue, &contact).unwrap();
                    let (shift_hz, depth) = (found.shift_hz, HELD);
                    touches.push(PosedTouch {
                        sample,
                        pose,
                        depth,
                        shift_hz,
                        sigma_hz: 0.05,
                        reference_sigma_hz: 0.0,
                        halfway: None,
                        stage_sigma_mm: None,
                    });
                }
            }
        }
        touches
    }

    fn model(&self, source: ModelSource) -> RunModel {
        model(&self.touches(&ANGLES_DEG), source)
    }
}

fn model(touches: &[PosedTouch], source: ModelSource) -> RunModel {
    let known_mpa = SAMPLES_MPA.map(Some);
    let main = MainTouches {
        touches,
        known_mpa: &known_mpa,
        sample_rel: 0.03,
        depth_correlation: None,
        reference_hz2: None,
    };
    let described = Compensation::new(&SensorDescription::reference(), 0.002);
    RunModel::of(&described, &main, source)
}

/// Sites whose angles are unknown agree within a percent, or two of them differ by six standard
/// deviations.
#[test]
fn sites_of_unknown_angle_judge_the_model_by_chi2() {
    let described = Compensation::new(&SensorDescription::reference(), 0.002);
    let site = |sample: usize, off: f64| {
        let mpa = SAMPLES_MPA[sample] * (1.0 + off);
        (sample, Young { mpa, sigma_mpa: 0.02 * mpa })
    };
    let even: Vec<_> =
        (0..5).flat_map(|sample| [site(sample, 0.01), site(sample, -0.01)]).collect();
    let check = RunModel::of_sites(&described, &even, &[]).check().unwrap().clone();
    assert_eq!((check.verdict, check.freedom, check.residuals.len()), (Verdict::Holds, 5, 10));
    let mut odd = even;
    odd[3] = site(1, 0.2);
    let check = RunModel::of_sites(&described, &odd, &[]).check().unwrap().clone();
    assert_eq!((check.verdict, check.pattern), (Verdict::Rejected, None), "{check:?}");
    assert!(check.added_rel > 0.03, "{check:?}");
    assert!(RunModel::of_sites(&described, &odd[..1], &[]).check().is_none());
}

#[test]
fn a_model_that_is_the_truth_holds_and_stays_as_it_is() {
    for source in [ModelSource::Described, ModelSource::Learnt] {
        let model = MATCHED.model(source);
        let check = model.check().unwrap();
        assert_eq!((check.verdict, check.pattern), (Verdict::Holds, None), "{check:?}");
        assert!(check.added_rel < 0.02 && check.residuals.len() == 60, "{check:?}");
        let ratio = model.terms().tangential_ratio;
        assert!((ratio - 2.0 / 3.0).abs() < 0.06, "{ratio}");
        assert_eq!((model.terms().arm_mm, model.terms().deflects), (8.0, false));
    }
}

#[track_caller]
fn rejected(truth: &Truth, pattern: Pattern) {
    let described = truth.model(ModelSource::Described);
    let check = described.check().unwrap();
    assert_eq!((check.verdict, check.pattern), (Verdict::Rejected, Some(pattern)), "{check:?}");
    assert!(check.added_rel > 0.0, "{check:?}");
    assert_eq!(described.terms(), described.described(), "it learns nothing");
}

#[test]
fn a_truth_within_elastic_contact_is_rejected_as_described_and_learnt() {
    #[track_caller]
    fn check(truth: &Truth, pattern: Pattern, value: impl Fn(&RunModel) -> (f64, f64)) {
        rejected(truth, pattern);
        let model = truth.model(ModelSource::Learnt);
        assert_eq!(model.check().unwrap().verdict, Verdict::Holds, "{:?}", model.check());
        let (found, expected) = value(&model);
        assert!((found - expected).abs() < 0.15 * expected.max(0.5), "{found} for {expected}");
    }
    let ratio = |model: &RunModel| model.terms().tangential_ratio;
    for expected in [0.0, 1.0 / 3.0, 1.0] {
        let friction = Friction::Elastic { tangential_ratio: expected };
        check(&Truth { friction, ..MATCHED }, Pattern::Friction, |model| (ratio(model), expected));
    }
    let arm = |model: &RunModel| (model.terms().arm_mm, 4.0);
    check(&Truth { arm_mm: 4.0, ..MATCHED }, Pattern::Arm, arm);
    let stage = Truth { depth: Depth::Stage { along_probe_mm: 0.5 }, ..MATCHED };
    assert_ne!(stage.model(ModelSource::Described).check().unwrap().verdict, Verdict::Holds);
    assert!(stage.model(ModelSource::Learnt).terms().deflects, "the known samples show it");
}

#[test]
fn a_contact_that_slips_from_an_angle_on_is_noticed_and_not_learnt_away() {
    let truth = Truth { slips_beyond_deg: 8.53, ..MATCHED };
    rejected(&truth, Pattern::Friction);
    let learnt = truth.model(ModelSource::Learnt);
    let check = learnt.check().unwrap();
    assert_ne!(check.verdict, Verdict::Holds, "{check:?}");
    assert_eq!(check.pattern, Some(Pattern::Friction));
    // Calibrated at 0°, where it sticks, the other touches are off by six to eight percent.
    assert!((0.04..0.12).contains(&check.added_rel), "{check:?}");
}

#[test]
fn one_sample_that_does_not_agree_with_itself_is_named() {
    rejected(&Truth { third: [1.2, 0.8, 1.2, 0.8], ..MATCHED }, Pattern::Sample(2));
}

#[test]
fn touches_that_do_not_identify_a_term_do_not_learn_it() {
    // Upright, the arm moves the ball along the surface only; one angle more identifies friction.
    let upright = model(&MATCHED.touches(&[0.0]), ModelSource::Learnt);
    assert_eq!(upright.learnt(), []);
    assert!(upright.check().is_some());
    // Two touches of two samples leave no degree of freedom.
    let touches = MATCHED.touches(&[0.0]);
    assert_eq!(model(&[touches[0], touches[3]], ModelSource::Learnt).check(), None);
    assert_eq!(model(&[], ModelSource::Learnt).check(), None);
}

/// The stiffness of a touch moves with a term as its gradient says.
#[test]
fn a_gradient_is_the_change_of_the_stiffness_with_the_term() {
    let truth = Truth { arm_mm: 4.0, ..MATCHED };
    let model = truth.model(ModelSource::Learnt);
    let names: Vec<_> = model.learnt().iter().map(|learnt| learnt.term.name()).collect();
    assert_eq!(names, ["tangential_ratio", "arm_mm"]);
    let touch = truth.touches(&[45.0])[12];
    let found = model.of_touch(&touch).unwrap();
    let log = |ratio: f64, arm_mm: f64| {
        let terms = Terms { tangential_ratio: ratio, arm_mm, deflects: false };
        let described = Compensation::new(&SensorDescription::reference(), 0.0);
        described.with(&terms).unwrap().log_young(&touch).unwrap()
    };
    let Terms { tangential_ratio: ratio, arm_mm, .. } = *model.terms();
    let by_ratio = (log(ratio + 1e-4, arm_mm) - log(ratio - 1e-4, arm_mm)) / 2e-4;
    let by_arm = (log(ratio, arm_mm + 1e-3) - log(ratio, arm_mm - 1e-3)) / 2e-3;
    assert!((found.gradient[0] / by_ratio - 1.0).abs() < 1e-3, "{found:?} {by_ratio}");
    assert!((found.gradient[1] / by_arm - 1.0).abs() < 1e-2, "{found:?} {by_arm}");
}

/// Under a depth that the stage holds, another law makes stiff samples stiffer against soft ones; one depth
/// does not show it, and the uncertainty of the model covers it. A held indentation has no such part.
#[test]
fn a_depth_that_the_stage_holds_allows_for_another_law() {
    let part = |truth: &Truth| {
        let touches = truth.touches(&ANGLES_DEG);
        let model = model(&touches, ModelSource::Learnt);
        let gradient = |touch: &PosedTouch| model.of_touch(touch).unwrap().gradient;
        assert!(model.covariance().iter().all(|row| row.len() == model.covariance().len()));
        (gradient(&touches[0]), gradient(&touches[48]), model.learnt().len())
    };
    let (soft, stiff, learnt) =
        part(&Truth { depth: Depth::Stage { along_probe_mm: 0.5 }, ..MATCHED });
    // The last is the way to the rival.
    assert_eq!((soft.len(), stiff.len()), (learnt + 2, learnt + 2));
    let less_deep = soft[learnt] - stiff[learnt];
    assert!((0.4..0.7).contains(&less_deep), "{soft:?} {stiff:?}");
    let (soft, _, learnt) = part(&MATCHED);
    assert_eq!(soft.len(), learnt + 1);
}

/// The known samples and the angles tell the way in which the depth is held. Upright touches of unknown samples
/// leave both ways equally probable, and a described model has no rival.
#[test]
fn the_way_to_hold_the_depth_that_was_not_taken_stays_as_probable_as_the_touches_leave_it() {
    let probability = |model: &RunModel| *model.covariance().last().unwrap().last().unwrap();
    let stage = Truth { depth: Depth::Stage { along_probe_mm: 0.5 }, ..MATCHED };
    for truth in [MATCHED, stage] {
        let found = probability(&truth.model(ModelSource::Learnt));
        assert!(found < 0.02, "{found}");
    }
    let upright = MATCHED.touches(&[0.0]);
    let main = MainTouches {
        touches: &upright,
        known_mpa: &[None; 5],
        sample_rel: 0.03,
        depth_correlation: None,
        reference_hz2: None,
    };
    let described = Compensation::new(&SensorDescription::reference(), 0.002);
    let model = RunModel::of(&described, &main, ModelSource::Learnt);
    let found = probability(&model);
    assert!((0.4..=0.6).contains(&found), "{found}");
    // A stiff sample deflects the sensor, and is less deep than the stage moved.
    let to_rival = |touch: &PosedTouch| *model.of_touch(touch).unwrap().gradient.last().unwrap();
    let (soft, stiff) = (to_rival(&upright[0]), to_rival(&upright[12]));
    assert!((0.2..0.6).contains(&(stiff - soft)), "{soft} {stiff}");
    assert!(RunModel::of(&described, &main, ModelSource::Described).covariance().is_empty());
}

/// A known stiffness that is a third too small sets its sample apart, whatever the angles say.
#[test]
fn samples_of_known_stiffness_that_disagree_are_noticed_and_widen_the_intervals() {
    let touches = MATCHED.touches(&ANGLES_DEG);
    let described = Compensation::new(&SensorDescription::reference(), 0.002);
    let check = |known_mpa: [Option<f64>; 5]| {
        let main = MainTouches {
            touches: &touches,
            known_mpa: &known_mpa,
            sample_rel: 0.03,
            depth_correlation: None,
            reference_hz2: None,
        };
        RunModel::of(&described, &main, ModelSource::Learnt).check().unwrap().clone()
    };
    let mut known_mpa = SAMPLES_MPA.map(Some);
    known_mpa[2] = Some(0.75 * SAMPLES_MPA[2]);
    let found = check(known_mpa);
    assert_eq!((found.verdict, found.pattern), (Verdict::Rejected, Some(Pattern::Known(2))));
    // The logarithms are 0.23 above and 0.06 below their mean.
    assert!((0.11..0.14).contains(&found.added_rel), "{found:?}");
    // One known sample has nothing to disagree with.
    let one = check([None, None, Some(0.75 * SAMPLES_MPA[2]), None, None]);
    assert_eq!((one.verdict, one.pattern), (Verdict::Holds, None), "{one:?}");
    assert!(one.evidence.iter().all(|one| one.pattern.name() != "known"), "{one:?}");
}

/// Of 40 runs with the stated errors, at least as many as the check says notice that the touch slides that needs
/// most friction, within four standard deviations. It says 95 of 100, so that every slip is noticed as often.
#[test]
fn a_slip_is_noticed_as_often_as_the_check_says() {
    const RUNS: u64 = 40;
    let described = Compensation::new(&SensorDescription::reference(), 0.002);
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let smooth = MATCHED.touches(&ANGLES_DEG);
    let needed: Vec<f64> = smooth
        .iter()
        .map(|touch| described.needed_friction(touch, SAMPLES_MPA[touch.sample]).unwrap())
        .collect();
    let run = |seed: u64, coefficient: f64| {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut normal = || {
            let [a, b] = [0, 1].map(|_| (random.next_u64() as f64 + 1.0) / 2.0_f64.powi(64));
            (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        let touches: Vec<PosedTouch> = (smooth.iter().zip(&needed))
            .map(|(touch, needed)| {
                let one = described.of_touch(touch).unwrap();
                let sigma = (one.sigma_mpa / one.young_mpa).hypot(0.03);
                let young_mpa = SAMPLES_MPA[touch.sample] * (sigma * normal()).exp();
                let slides = *needed > coefficient;
                let friction = if slides { Friction::Frictionless } else { Friction::Sticking };
                let (pose, depth, law) = (touch.pose, touch.depth, ContactLaw::Sneddon);
                let contact = Contact { pose, depth, law, friction };
                let tissue = Tissue::soft(young_mpa).unwrap();
                let found = models.predict(Tier::Reference, &tissue, &contact).unwrap();
                PosedTouch { shift_hz: found.shift_hz, ..*touch }
            })
            .collect();
        model(&touches, ModelSource::Learnt)
    };
    let slip = run(0, 9.0).check().unwrap().slip_noticed.unwrap();
    assert!((slip.begins_below - 1.2).abs() < 0.1, "{slip:?}");
    let expected = slip.share_of_first;
    assert!(expected > 0.95 && slip.below == Some(slip.begins_below), "{slip:?}");
    let found: Vec<RunModel> = (0..RUNS).map(|seed| run(seed, 1.0)).collect();
    let noticed: Vec<&ModelCheck> = found
        .iter()
        .filter_map(RunModel::check)
        .filter(|check| check.verdict != Verdict::Holds)
        .collect();
    let share = noticed.len() as f64 / RUNS as f64;
    let sigma = (expected * (1.0 - expected) / RUNS as f64).sqrt();
    assert!(share > expected - 4.0 * sigma, "{share} instead of {expected}");
    // A model that does not hold says nothing of what it would show.
    let says =
        |check: &&ModelCheck| check.slip_noticed.is_some() || check.exponent_noticed.is_some();
    assert!(!noticed.iter().any(says), "{noticed:?}");
}
