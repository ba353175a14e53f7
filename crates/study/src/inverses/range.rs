//! From 0.001 to 30 MPa: sensitivity, uncertainty and the agreement of two tiers.

use rig_chart::{Axis, Chart, Point, Series};
use rig_contact::{ContactLaw, Direction, Models, Sensor, Tier, inverse::TissueKind};

use super::known::TOUCH_SIGMAS;
use crate::{
    page::{Page, Table},
    paper_bench::{Control, INDENTATION_MM, contact, tissue},
};

/// Young's moduli of the table, MPa.
const TABLE_MPA: [f64; 14] =
    [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 10.0, 30.0];

/// The results for one stiffness.
struct RangePoint {
    /// The shift by the reference, Hz, and its slope, Hz/MPa, or the reason of a refusal.
    shift: Result<(f64, f64), String>,
    /// Relative standard deviation of the stiffness, or the reason of a refusal.
    sigma: Result<f64, String>,
    /// Relative difference of the stiffness by tier E1s, for a shift by the reference.
    model: Result<f64, String>,
}

pub(super) fn add(page: &mut Page) {
    page.heading("From 0.001 to 30 MPa");
    page.text(
        "Upright, with the errors of a touch on the bench, over a range that exceeds the samples' \
         on both sides. Below about 0.003 MPa the shift is lost in its noise of 0.3 Hz, and the \
         stiffness is refused. With the indentation held the shift saturates slowly at high \
         stiffness: the slope falls to a half at 1 MPa and to a third at 3 MPa, which a shift of \
         hundreds of hertz outweighs. With the stage held the sensor deflects, and the indentation \
         of a sample much stiffer than the sensor is a small part of the move, so that the error \
         of the depth dominates. The last column is the difference between tier E1s and the \
         reference, which gave the shift: agreement of two models, and not accuracy. With the \
         indentation held above 4 MPa, the force turns the end of the sensor by more than the models \
         take.",
    );
    let mut table = Table::new(&[
        "held",
        "stiffness, MPa",
        "shift, Hz",
        "slope, Hz/MPa",
        "standard deviation, %",
        "difference of tier E1s from the reference, %",
    ]);
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    for control in Control::ALL {
        for young_mpa in TABLE_MPA {
            let range_point = range_point(&models, control, young_mpa);
            let shift = &range_point.shift;
            let percent = |value: Result<f64, String>, digits: usize| match value {
                Ok(value) => format!("{:.digits$}", 100.0 * value),
                Err(reason) => format!("refused: {reason}"),
            };
            table.row([
                control.name().to_owned(),
                young_mpa.to_string(),
                shift.as_ref().map_or("refused".to_owned(), |(hz, _)| format!("{hz:.3}")),
                shift.as_ref().map_or("refused".to_owned(), |(_, slope)| format!("{slope:.1}")),
                percent(range_point.sigma, 2),
                percent(range_point.model, 2),
            ]);
        }
    }
    page.table(table);
    page.chart("range-sensitivity.svg", sensitivity_chart(&models));
    page.chart("range.svg", uncertainty_chart(&models));
}

fn range_point(models: &Models, control: Control, young_mpa: f64) -> RangePoint {
    let depth = control.depth(INDENTATION_MM);
    let contact = contact(Direction::Front, 0.0, depth, ContactLaw::Sneddon);
    let shift = |young_mpa: f64| {
        models
            .predict(Tier::Reference, &tissue(young_mpa), &contact)
            .map(|found| found.shift_hz)
            .map_err(|refusal| refusal.to_string())
    };
    let shifts = || {
        let slope = (shift(young_mpa * 1.01)? - shift(young_mpa * 0.99)?) / (0.02 * young_mpa);
        Ok((shift(young_mpa)?, slope))
    };
    let shift_hz = match shift(young_mpa) {
        Ok(shift_hz) => shift_hz,
        Err(reason) => {
            let [sigma, model] = [Err(reason.clone()), Err(reason.clone())];
            return RangePoint { shift: Err(reason), sigma, model };
        }
    };
    let kind = TissueKind::SOFT;
    let sigma = models
        .stiffness_of_touch(Tier::E1s, shift_hz, TOUCH_SIGMAS, kind, &contact)
        .map(|found| found.sigma_mpa / found.young_mpa)
        .map_err(|refusal| refusal.to_string());
    let model = models
        .young_of_shift_mpa(Tier::E1s, shift_hz, kind, &contact)
        .map(|found| found / young_mpa - 1.0)
        .map_err(|refusal| refusal.to_string());
    RangePoint { shift: shifts(), sigma, model }
}

/// Stiffnesses of the curves, from 0.001 to 10 MPa.
fn curve_mpa() -> impl Iterator<Item = f64> {
    (0..=64).map(|step| 0.001 * 1e4_f64.powf(f64::from(step) / 64.0))
}

fn sensitivity_chart(models: &Models) -> Chart {
    let mut chart = Chart::new(
        "Sensitivity of the shift over the stiffness",
        "Slope of the shift, upright at 0.5 mm, with the indentation held and with the stage held. \
         It falls as the contact becomes stiffer than the sensor.",
        Axis::log("stiffness, MPa"),
        Axis::log("slope, Hz/MPa"),
    );
    for (colour, control) in Control::ALL.into_iter().enumerate() {
        let point = |young: f64| {
            let (_, slope) = range_point(models, control, young).shift.ok()?;
            Some((young, slope))
        };
        let points: Vec<(f64, f64)> = curve_mpa().filter_map(point).collect();
        chart.series.push(Series::line(&format!("{} held", control.name()), colour, points));
    }
    chart
}

fn uncertainty_chart(models: &Models) -> Chart {
    let mut chart = Chart::new(
        "Relative standard deviation of the stiffness of one touch",
        "Over the stiffness from 0.001 to 10 MPa, with the indentation held and with the stage \
         held. The curves end with the first refusal.",
        Axis::log("stiffness, MPa"),
        Axis::log("standard deviation, %"),
    );
    for (colour, control) in Control::ALL.into_iter().enumerate() {
        let points: Vec<Point> = curve_mpa()
            .filter_map(|young_mpa| {
                let sigma = range_point(models, control, young_mpa).sigma.ok()?;
                Some(Point::from((young_mpa, 100.0 * sigma)))
            })
            .collect();
        let name = format!("{} held", control.name());
        chart.series.push(Series::line(&name, colour, points));
    }
    chart
}
