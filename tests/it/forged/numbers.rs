//! Forged results: readings, resonances, shifts, surfaces, depths. Copies are forged along.

use rig_tests::forge::Forgery;
use rig_verify::Check;
use serde_json::{Value, json};

use super::{Case, any, change, get};

fn is_touch_sweep(payload: &Value) -> bool {
    payload["purpose"] == "touch"
}

fn sweep(forged: &mut Forgery, n: usize) -> &mut Value {
    let place = forged.nth("sweep", n, is_touch_sweep);
    &mut forged.records[place].payload
}

fn result(forged: &mut Forgery, n: usize) -> &mut Value {
    let place = forged.nth("touch_result", n, any);
    &mut forged.records[place].payload
}

/// Changes the resonance of the sweep and of everything that follows from it.
fn loaded(forged: &mut Forgery, n: usize, hz: impl Fn(f64) -> f64, sigma: impl Fn(f64) -> f64) {
    change(sweep(forged, n), "/outcome/resonance_hz", &hz);
    change(sweep(forged, n), "/outcome/sigma_hz", &sigma);
    let result = result(forged, n);
    change(result, "/resonance_hz", &hz);
    change(result, "/sigma_hz", &sigma);
    let shift = get(result, "/resonance_hz") - get(result, "/no_load_hz");
    result["shift_hz"] = shift.into();
    let sigma = get(result, "/sigma_hz").hypot(get(result, "/no_load_sigma_hz"));
    let sigma = sigma.hypot(get(result, "/drift_sigma_hz"));
    result["shift_sigma_hz"] = sigma.into();
}

fn readings(sweep: &mut Value) -> &mut Vec<Value> {
    sweep["readings"].as_array_mut().expect("readings")
}

/// States a noise that is smaller by a factor, as known with these degrees of freedom.
fn noise(forged: &mut Forgery, n: usize, factor: f64, degrees: f64) {
    change(sweep(forged, n), "/fit/noise/at_ten_cycles", |noise| noise / factor);
    change(sweep(forged, n), "/fit/noise/degrees_of_freedom", |_| degrees);
}

pub(super) const CASES: &[Case] = &[
    ("a changed reading", Check::Resonance, |forged| {
        change(&mut readings(sweep(forged, 3))[15], "/resistance_ohm", |r| 1.5 * r);
        change(&mut readings(sweep(forged, 3))[15], "/reactance_ohm", |x| 1.5 * x);
    }),
    ("a reading with another sign", Check::Resonance, |forged| {
        change(&mut readings(sweep(forged, 3))[15], "/resistance_ohm", |r| -r);
    }),
    ("readings at other frequencies", Check::Resonance, |forged| {
        for reading in readings(sweep(forged, 3)) {
            change(reading, "/frequency_hz", |hz| hz + 2.0);
        }
    }),
    ("swapped sweeps", Check::Resonance, |forged| {
        let (first, second) =
            (readings(sweep(forged, 1)).clone(), readings(sweep(forged, 3)).clone());
        (*readings(sweep(forged, 1)), *readings(sweep(forged, 3))) = (second, first);
    }),
    ("a resonance that is wrong by two standard deviations", Check::Resonance, |forged| {
        let sigma = get(sweep(forged, 2), "/outcome/sigma_hz");
        loaded(forged, 2, |hz| hz + 2.0 * sigma, |sigma| sigma);
    }),
    ("a resonance that is wrong by 20 Hz", Check::Resonance, |forged| {
        loaded(forged, 2, |hz| hz + 20.0, |sigma| sigma);
    }),
    ("a resonance without readings", Check::Resonance, |forged| {
        readings(sweep(forged, 2)).truncate(2);
    }),
    ("another quality factor", Check::Resonance, |forged| {
        change(sweep(forged, 2), "/outcome/circuit/quality_factor", |q| 4.0 * q);
    }),
    ("a standard deviation that is too small", Check::Sigma, |forged| {
        loaded(forged, 2, |hz| hz, |sigma| sigma / 6.0);
    }),
    ("a standard deviation that is too large", Check::Sigma, |forged| {
        loaded(forged, 2, |hz| hz, |sigma| 12.0 * sigma);
    }),
    ("every resonance in contact half a standard deviation higher", Check::Resonance, |forged| {
        for n in 0..18 {
            let sigma = get(sweep(forged, n), "/outcome/sigma_hz");
            loaded(forged, n, |hz| hz + 0.5 * sigma, |sigma| sigma);
        }
    }),
    ("every standard deviation in contact a quarter smaller", Check::Sigma, |forged| {
        for n in 0..18 {
            loaded(forged, n, |hz| hz, |sigma| 0.75 * sigma);
        }
    }),
    ("the same by readings that are said to be left out", Check::Resonance, |forged| {
        for n in 0..18 {
            let sigma = get(sweep(forged, n), "/outcome/sigma_hz");
            loaded(forged, n, |hz| hz + 0.5 * sigma, |sigma| sigma);
            sweep(forged, n)["outcome"]["left_out"] = json!(1);
        }
    }),
    ("a sweep without what its fit knew", Check::Request, |forged| {
        sweep(forged, 2).as_object_mut().expect("a record").remove("fit");
    }),
    ("readings that are said to have settled", Check::Request, |forged| {
        sweep(forged, 2)["fit"]["timing"] = json!("waited");
    }),
    ("a stated noise that is too small", Check::Sigma, |forged| noise(forged, 5, 20.0, 1000.0)),
    ("a small noise with plausible degrees of freedom", Check::Sigma, |forged| {
        noise(forged, 5, 20.0, 60.0);
    }),
    ("a small noise of the first touch", Check::Sigma, |forged| noise(forged, 0, 3.0, 20.0)),
    ("a small noise of the last touch", Check::Sigma, |forged| noise(forged, 17, 20.0, 60.0)),
    ("less precise than asked for", Check::Request, |forged| {
        loaded(forged, 2, |hz| hz, |_| 0.101);
    }),
    ("a wider window", Check::Request, |forged| {
        sweep(forged, 2)["fit"]["window_hz"] = json!([100.0, 300.0]);
    }),
    ("another precision asked for", Check::Request, |forged| {
        sweep(forged, 2)["fit"]["target_sigma_hz"] = json!(0.2);
    }),
    ("another shift", Check::Shift, |forged| {
        change(result(forged, 4), "/shift_hz", |hz| hz + 0.01);
    }),
    ("another standard deviation of a shift", Check::Shift, |forged| {
        change(result(forged, 4), "/shift_sigma_hz", |hz| 0.9 * hz);
    }),
    ("a touch without a shift", Check::Shift, |forged| {
        let shift = get(result(forged, 4), "/shift_hz");
        loaded(forged, 4, |hz| hz, |_| shift / 5.0);
    }),
    ("a resonance that is not that of the sweep", Check::Copy, |forged| {
        change(result(forged, 4), "/resonance_hz", |hz| hz + 1.0);
        change(result(forged, 4), "/shift_hz", |hz| hz + 1.0);
    }),
    ("a reference that is not that of its sweep", Check::Reference, |forged| {
        change(result(forged, 4), "/no_load_hz", |hz| hz + 1.0);
        change(result(forged, 4), "/shift_hz", |hz| hz - 1.0);
    }),
    ("another sweep in a result", Check::Copy, |forged| {
        result(forged, 4)["sweep"] = json!(2);
    }),
    ("another tilt in a result", Check::Copy, |forged| {
        change(result(forged, 4), "/rotary_deg", |deg| deg + 1.0);
    }),
    ("another surface", Check::Surface, |forged| {
        let place = forged.nth("surface_found", 1, any);
        change(&mut forged.records[place].payload, "/position_mm", |mm| mm + 0.05);
    }),
    ("another standard deviation of a surface", Check::Surface, |forged| {
        let place = forged.nth("surface_found", 1, any);
        change(&mut forged.records[place].payload, "/sigma_mm", |mm| 0.5 * mm);
    }),
    ("another place of a search", Check::Surface, |forged| {
        let place = forged.nth("surface_found", 1, any);
        change(&mut forged.records[place].payload, "/trail/2/position_mm", |mm| mm + 0.02);
    }),
    ("a result without the surface that was looked for again", Check::Surface, |forged| {
        let place = forged.nth("surface_checked", 1, any);
        forged.records.remove(place);
    }),
    ("a result with a surface that was not there after the sweep", Check::Surface, |forged| {
        let place = forged.nth("surface_checked", 1, any);
        let trail = &mut forged.records[place].payload["trail"];
        let above = trail[0]["reading"].clone();
        for key in ["resistance_ohm", "reactance_ohm"] {
            trail[1]["reading"][key] = above[key].clone();
        }
    }),
    ("another place where the surface was looked for", Check::Surface, |forged| {
        let place = forged.nth("surface_checked", 1, any);
        change(&mut forged.records[place].payload, "/trail/0/position_mm", |mm| mm + 0.02);
    }),
    ("a surface in a result that was not found", Check::Copy, |forged| {
        change(result(forged, 4), "/surface_mm", |mm| mm + 0.01);
        change(result(forged, 4), "/indentation_mm", |mm| mm + 0.01);
    }),
    ("another depth", Check::Indentation, |forged| {
        change(result(forged, 4), "/indentation_mm", |mm| mm + 0.1);
    }),
    ("another depth in the protocol", Check::Indentation, |forged| {
        let text = &mut forged.records[0].payload["protocol"]["toml"];
        *text = text
            .as_str()
            .expect("TOML")
            .replace("indentation_mm = 0.5", "indentation_mm = 0.4")
            .into();
    }),
    ("a smaller limit of the depth in the rig file", Check::Depth, |forged| {
        let text = &mut forged.records[0].payload["rig"]["toml"];
        let changed = text
            .as_str()
            .expect("TOML")
            .replace("max_indentation_mm = 0.8", "max_indentation_mm = 0.3");
        *text = changed.into();
    }),
];
