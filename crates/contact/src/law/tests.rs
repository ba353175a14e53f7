use super::*;

#[track_caller]
fn close(found: f64, expected: f64, relative: f64) {
    assert!((found / expected - 1.0).abs() <= relative, "{found} is not {expected}");
}

fn radius(law: ContactLaw, depth: f64) -> f64 {
    law.at(depth).unwrap().radius_rel
}

/// Values from x atanh x = D solved with forty digits.
#[test]
fn radii_at_a_depth_of_one_ball_radius() {
    close(radius(ContactLaw::Paper, 1.0), 0.75_f64.sqrt(), 1e-15);
    close(radius(ContactLaw::Hertz, 1.0), 1.0, 1e-15);
    close(radius(ContactLaw::Sneddon, 1.0), 0.833_556_559_600_964_7, 1e-14);
    close(radius(ContactLaw::SneddonSeries, 1.0), 0.833_640_155_156_433, 1e-14);
    close(radius(ContactLaw::NeoHookean, 1.0), 0.75, 1e-15);
}

#[test]
fn the_series_is_within_its_stated_error_up_to_its_limit_and_refused_beyond() {
    for step in 1..=1000 {
        let depth = f64::from(step) / 1000.0;
        close(radius(ContactLaw::SneddonSeries, depth), radius(ContactLaw::Sneddon, depth), 1.1e-4);
        let force = |law: ContactLaw| law.at(depth).unwrap().force_rel;
        close(force(ContactLaw::SneddonSeries), force(ContactLaw::Sneddon), 1.5e-4);
    }
    assert!(ContactLaw::SneddonSeries.at(1.0 + 1e-12).is_err());
}

#[test]
fn force_is_the_integral_of_the_stiffness_for_every_law() {
    for law in ContactLaw::ALL {
        for depth in [1e-12, 1e-6, 1e-3, 0.01, 0.024, 0.03, 0.2, 0.7, 0.999] {
            let step = 1e-5 * depth;
            let force = |d: f64| law.at(d).unwrap().force_rel;
            let slope = (force(depth + step) - force(depth - step)) / (2.0 * step);
            // The series' force and radius are cut at the same power, not derived from each other.
            let tolerance = if law == ContactLaw::SneddonSeries { 2e-3 } else { 1e-8 };
            close(slope, 2.0 * radius(law, depth), tolerance);
        }
    }
}

#[test]
fn shallow_contacts_keep_their_digits() {
    for law in ContactLaw::ALL {
        for exponent in 4..200 {
            let depth = 10.0_f64.powi(-exponent);
            let patch = law.at(depth).unwrap();
            // All laws become Hertz's, with a relative difference below D/4.
            close(patch.radius_rel, depth.sqrt(), 0.26 * depth + 1e-15);
            close(patch.force_rel, 4.0 / 3.0 * depth * depth.sqrt(), 0.26 * depth + 1e-13);
        }
        assert_eq!(law.at(0.0), Ok(ContactPatch::NONE), "{law:?}");
    }
}

#[test]
fn depths_on_both_sides_of_each_limit() {
    for law in ContactLaw::ALL {
        let limit = law.depth_limit_rel();
        assert!(law.at(limit).is_ok());
        assert!(law.at(limit * (1.0 + 1e-15)).is_err());
        assert!(law.at(-f64::MIN_POSITIVE).is_err());
        assert!(law.at(f64::NAN).is_err());
    }
    assert_eq!(
        ContactLaw::Paper.at(4.1).unwrap_err().to_string(),
        "paper contact law: depth of 4.1 ball radii is outside [0, 2]"
    );
}

#[test]
fn sneddons_solution_stays_stable_far_beyond_its_validity() {
    for depth in [2.0, 2.9, 3.1, 10.0, 18.0, 1e3] {
        let (x, force) = sneddon::at(depth);
        assert!(x <= 1.0 && force.is_finite());
        // A ball sunk deep is a flat punch: the force grows by two for each unit of depth.
        let (_, next) = sneddon::at(depth + 1.0);
        close(next - force, 2.0, 0.07);
    }
}
