//! The page with the trend of the daily checks.

use std::path::{Path, PathBuf};

use rig_commission::{
    Basis, Calibration,
    check::{CheckValues, Checked, Quantity, judge},
    checks,
    control::SCORE_LIMIT,
};
use rig_report::trend::{Trend, TrendCheck, TrendPanel, TrendPoint};

use super::CheckError;
use crate::{
    calibrations,
    durable::{self, FOR_ALL},
    local_time::local,
};

/// Its file in a data directory.
const TREND: &str = "checks.html";

/// Writes the page anew from the records, and returns its path.
///
/// # Errors
/// [`CheckError`].
pub(super) fn write(rig: &str, basis: &Basis, data: &Path) -> Result<PathBuf, CheckError> {
    let path = data.join(TREND);
    let failed = |source| CheckError::Trend { path: path.clone(), source };
    let html = page(rig, basis, data)?;
    durable::replace_bytes(&path, html.as_bytes(), FOR_ALL).map_err(failed)?;
    Ok(path)
}

/// The page of the checks that are comparable with the last one.
fn page(rig: &str, basis: &Basis, data: &Path) -> Result<String, CheckError> {
    let records = calibrations::read(data)?;
    let all = checks(&records, basis, None);
    let protocols = all.last().and_then(|last| last.protocols_sha256());
    let comparable = checks(&records, basis, protocols);
    let values = |record: &&Calibration| CheckValues::of(record);
    let (found, values): (Vec<_>, Vec<_>) =
        comparable.into_iter().filter_map(|record| Some((record, values(&record)?))).unzip();
    let judged = (!values.is_empty()).then(|| judge(&values));
    let panels = judged.iter().flat_map(|judged| panels(judged, &found)).collect();
    let check = |record: &&Calibration| TrendCheck {
        made: local(record.made()),
        person: record.person().to_owned(),
        verdict: record.verdict.clone(),
        reason: record.reason.clone().unwrap_or_default(),
    };
    Ok(Trend { rig: rig.to_owned(), panels, checks: found.iter().map(check).collect() }.html())
}

fn panels(judged: &Checked, found: &[&Calibration]) -> Vec<TrendPanel> {
    let panel = |(quantity, charted): (Quantity, &Vec<_>)| {
        let point = |(charted, record): (&rig_commission::control::Charted, &&Calibration)| {
            let limits = charted.against.map(|against| {
                let half = SCORE_LIMIT * against.sigma;
                (against.mean - half, against.mean + half)
            });
            TrendPoint {
                value: charted.value,
                made: local(record.made()),
                limits,
                average: charted.against.map(|against| against.average),
                is_alarm: charted.against.is_some_and(|against| against.is_alarm()),
            }
        };
        TrendPanel {
            title: quantity.text().to_owned(),
            unit: quantity.unit().to_owned(),
            least: quantity.least_sigma(),
            each: "check",
            points: charted.iter().zip(found).map(point).collect(),
        }
    };
    Quantity::ALL.into_iter().zip(&judged.charts).map(panel).collect()
}
