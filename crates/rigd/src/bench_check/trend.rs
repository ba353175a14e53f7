//! The trend of the daily checks: those that are comparable with the last one, and their page.

use std::path::{Path, PathBuf};

use rig_commission::{
    Basis, Calibration,
    check::{CheckValues, Checked, Quantity, judge},
    checks,
    control::{Charted, SCORE_LIMIT},
};
use rig_report::trend::{Trend, TrendCheck, TrendPanel, TrendPoint};

use super::CheckError;
use crate::{
    calibrations::{self, CalibrationsError},
    durable::{self, FOR_ALL},
    local_time::local,
};

/// Its file in a data directory.
const TREND: &str = "checks.html";

/// The checks that are comparable with the last one, the oldest first, and what their charts say.
#[derive(Debug)]
pub(crate) struct Series {
    /// Their records.
    pub(crate) checks: Vec<Calibration>,
    /// `None` without a check.
    judged: Option<Checked>,
}

impl Series {
    /// Reads the records of a data directory.
    ///
    /// # Errors
    /// [`CalibrationsError`].
    pub(crate) fn read(basis: &Basis, data: &Path) -> Result<Self, CalibrationsError> {
        let records = calibrations::read(data)?;
        let protocols = checks(&records, basis, None).pop().and_then(Calibration::protocols_sha256);
        let comparable = checks(&records, basis, protocols).into_iter();
        let with_values = |record: &Calibration| Some((record.clone(), CheckValues::of(record)?));
        let (checks, values): (Vec<_>, Vec<_>) = comparable.filter_map(with_values).unzip();
        let judged = (!values.is_empty()).then(|| judge(&values));
        Ok(Self { checks, judged })
    }

    /// The chart of each quantity; none without a check.
    pub(crate) fn charts(&self) -> impl Iterator<Item = (Quantity, &[Charted])> {
        let charts = self.judged.iter().flat_map(|judged| &judged.charts);
        Quantity::ALL.into_iter().zip(charts.map(Vec::as_slice))
    }

    fn panels(&self) -> Vec<TrendPanel> {
        let point = |(charted, record): (&Charted, &Calibration)| {
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
        let panel = |(quantity, charted): (Quantity, &[Charted])| TrendPanel {
            title: quantity.text().to_owned(),
            unit: quantity.unit().to_owned(),
            least: quantity.least_sigma(),
            each: "check",
            points: charted.iter().zip(&self.checks).map(point).collect(),
        };
        self.charts().map(panel).collect()
    }
}

/// Writes the page again from the records, and returns its path.
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
///
/// # Errors
/// [`CalibrationsError`].
pub(crate) fn page(rig: &str, basis: &Basis, data: &Path) -> Result<String, CalibrationsError> {
    let series = Series::read(basis, data)?;
    let check = |record: &Calibration| TrendCheck {
        made: local(record.made()),
        person: record.person().to_owned(),
        verdict: record.verdict.clone(),
        reason: record.reason.clone().unwrap_or_default(),
    };
    let (panels, checks) = (series.panels(), series.checks.iter().map(check).collect());
    Ok(Trend { rig: rig.to_owned(), panels, checks }.html())
}
