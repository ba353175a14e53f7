use super::*;

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
}

fn press(ball_mm: f64, depth_mm: f64, degrees: f64) -> Press {
    Press { ball_mm, depth_mm, angle_rad: degrees.to_radians() }
}

const TISSUE: TissueConstants = TissueConstants {
    young_pa: 0.235e6,
    poisson: 0.5,
    density_kg_per_m3: 1000.0,
    mass_factor: 1.0,
    resistance_factor: 1.0,
};

#[test]
fn the_stiffness_of_equation_1_is_that_of_a_rigid_punch() {
    let radius_m = 0.433e-3;
    let tissue = TissueImpedance::of(&TISSUE, PI * radius_m * radius_m);
    close(tissue.stiffness_n_per_m, 2.0 * 0.235e6 / 0.75 * radius_m, 1e-10);
    // 4 ρ a³/(π^1.5 (1 − ν)) π^1.5.
    close(tissue.mass_kg, 4.0 * 1000.0 / 0.5 * radius_m.powi(3), 1e-18);
    let at = tissue.at(882.0);
    close(at.re, tissue.resistance_kg_per_s, 0.0);
    close(at.im, 882.0 * tissue.mass_kg - tissue.stiffness_n_per_m / 882.0, 1e-12);
}

#[test]
fn the_contact_radius_falls_with_the_angle_only_within_its_validity() {
    close(contact_radius_mm(press(0.5, 0.5, 0.0)).unwrap(), 0.25 * 3.0_f64.sqrt(), 1e-15);
    assert!(contact_radius_mm(press(0.5, 1.0, 0.0)).is_ok());
    assert!(contact_radius_mm(press(0.5, 1.0 + 1e-12, 0.0)).is_err());
    // Tilted far enough, a depth beyond two radii is valid again, and wider than upright formula
    // values beyond the limit would be.
    assert!(contact_radius_mm(press(0.5, 1.2, 45.0)).is_ok());
}

/// The printed arithmetic gives 4.5 % more than the exact one.
#[test]
fn the_angle_influence_at_the_papers_choice() {
    close(angle_influence(1.0, Arithmetic::Exact).unwrap(), 0.103_066_177, 1e-9);
    close(angle_influence(1.0, Arithmetic::Printed).unwrap(), 0.107_737_859, 1e-9);
    let relative = |ball_over_depth: f64| {
        let depth = 1.0 / ball_over_depth;
        let upright = ContactLaw::Paper.at(depth).unwrap().radius_rel;
        angle_influence(depth, Arithmetic::Exact).unwrap() / upright
    };
    for (ball_over_depth, percent) in [(1.0, 11.9), (0.5, 4.4), (2.0, 14.2), (1e6, 15.9)] {
        close(100.0 * relative(ball_over_depth), percent, 0.05);
    }
    // D₁ never reaches zero where the equation holds.
    for step in 1..=2000 {
        let depth = f64::from(step) / 1000.0;
        assert!(angle_influence(depth, Arithmetic::Exact).unwrap() > 0.0);
    }
    assert!(angle_influence(2.001, Arithmetic::Exact).is_err());
}

#[test]
fn the_papers_bounds_on_the_balls_radius() {
    close(radius_without_angle_influence(Arithmetic::Exact), 0.25 * (1.0 + 0.5_f64.sqrt()), 1e-15);
    close(radius_without_angle_influence(Arithmetic::Printed), 0.416_667, 1e-6);
    assert_eq!(largest_separating_radius(1.2, Arithmetic::Exact), None);
    close(largest_separating_radius(1.17, Arithmetic::Exact).unwrap(), 2.462, 1e-3);
    close(largest_separating_radius_tilted(1.2, Arithmetic::Exact).unwrap(), 2.127, 1e-3);
    close(largest_separating_radius_tilted(1.2, Arithmetic::Printed).unwrap(), 1.691, 1e-3);
}

/// On both sides of each bound, by equation (9) itself.
#[test]
fn the_bound_separates_and_just_beyond_it_does_not() {
    let bound = largest_separating_radius(1.17, Arithmetic::Exact).unwrap();
    let ratio = |ball_over_depth: f64| {
        influence_over_discrimination(1.0 / ball_over_depth, 1.17, Arithmetic::Exact).unwrap()
    };
    assert!(ratio(bound * 0.999) < 1.0);
    assert!(ratio(bound * 1.001) > 1.0);
    let edge = 1.0 / 0.5_f64.sqrt().sqrt();
    assert_eq!(largest_separating_radius(edge + 1e-9, Arithmetic::Exact), None);
    assert!(largest_separating_radius(edge - 1e-9, Arithmetic::Exact).is_some());
}

#[test]
fn equation_9_for_the_three_sensors_and_at_its_singularity() {
    // Samples 3 and 1; the same for either length, because the equation has no sensor in it.
    let of = |depth_rel: f64| {
        influence_over_discrimination(depth_rel, 0.235 / 0.045, Arithmetic::Exact).unwrap()
    };
    close(of(1.0), 0.1472, 5e-5);
    close(of(0.5), 0.1753, 5e-5);
    close(of(0.0), 0.159_103_585 * 0.235 / 0.19, 1e-8);
    let at = |ratio| influence_over_discrimination(1.0, ratio, Arithmetic::Exact).unwrap();
    assert!(at(1.0).is_infinite());
    assert!(at(1.0 + 1e-9) > 1e8);
    assert!(at(1.0 - 1e-9) < -1e8);
    close(at(1.2), 6.0 * (1.0 - 0.880_989_43), 1e-7);
}
