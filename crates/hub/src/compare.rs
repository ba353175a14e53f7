//! Benches beside each other: what they find of the same reference samples.
//!
//! A reference sample has a known stiffness in the protocols. Benches that have a sample of one name and one known stiffness
//! are taken to have measured the same. Results whose model is rejected are left out.

use rig_commission::control::{self, SCORE_LIMIT};
use rig_report::trend::{TrendPanel, TrendPoint};
use serde::Serialize;
use tokio_postgres::Client;

use crate::reproducibility::Reproducibility;

/// Runs of a chart, and of an analysis, at most: the latest ones.
const RUNS_MAX: i64 = 200;
/// A relative difference of the stiffness that matters to nobody.
const LEAST_REL: f64 = 0.001;

/// A reference sample on the benches that have measured it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reference {
    /// Name of the sample.
    pub sample: String,
    /// Its known Young's modulus, MPa.
    pub known_mpa: f64,
    /// Whether no real device took part.
    pub is_simulated: bool,
    /// Repeatability and reproducibility of its stiffness, MPa; none for one bench.
    pub reproducibility: Option<Reproducibility>,
    /// The control chart of each bench.
    pub charts: Vec<BenchChart>,
}

/// The results of a sample on a bench, in the order in which they came, with their control chart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchChart {
    /// `LAB/NAME` of the bench.
    pub bench: String,
    /// The results.
    pub points: Vec<ChartPoint>,
}

/// A result on a control chart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChartPoint {
    /// Id of the run.
    pub run_id: String,
    /// When it began: UTC, RFC 3339, by the clock of the bench.
    pub started_at: String,
    /// The stiffness, MPa.
    pub stiffness_mpa: f64,
    /// Its standard deviation, MPa.
    pub sigma_mpa: Option<f64>,
    /// Between which values it was expected by those before, MPa; none for the first ten.
    pub limits_mpa: Option<[f64; 2]>,
    /// Whether the chart says that something has changed.
    pub is_alarm: bool,
}

struct Found {
    sample: String,
    known_mpa: f64,
    is_simulated: bool,
    bench: String,
    point: ChartPoint,
}

/// The reference samples, by name, with the latest runs of each bench.
///
/// # Errors
/// The error of PostgreSQL.
pub(crate) async fn references(client: &Client) -> Result<Vec<Reference>, tokio_postgres::Error> {
    let select = "
        SELECT sample, known_mpa, is_simulated, bench, run, started_at, stiffness_mpa, sigma_mpa FROM (
            SELECT s.sample, s.known_mpa, f.is_simulated, b.role::text AS bench, r.id::text AS run, r.started_at,
                   s.stiffness_mpa, s.sigma_mpa, r.received_at,
                   row_number() OVER (PARTITION BY s.sample, s.known_mpa, f.is_simulated, r.bench
                                      ORDER BY r.received_at DESC, r.id DESC) AS back
            FROM hub.stiffness AS s
            JOIN hub.result AS found ON found.run = s.run
            JOIN hub.run AS r ON r.id = s.run
            JOIN hub.run_fact AS f ON f.run = s.run
            JOIN hub.bench AS b ON b.id = r.bench
            WHERE s.known_mpa IS NOT NULL AND found.model_verdict IS DISTINCT FROM 'rejected'
        ) AS latest
        WHERE back <= $1
        ORDER BY sample, known_mpa, is_simulated, bench, back DESC";
    let rows = client.query(select, &[&RUNS_MAX]).await?;
    let found = rows.iter().map(|row| Found {
        sample: row.get(0),
        known_mpa: row.get(1),
        is_simulated: row.get(2),
        bench: row.get(3),
        point: ChartPoint {
            run_id: row.get(4),
            started_at: row.get(5),
            stiffness_mpa: row.get(6),
            sigma_mpa: row.get(7),
            limits_mpa: None,
            is_alarm: false,
        },
    });
    Ok(grouped(found))
}

/// Results in the order of sample and bench, as samples with their charts.
fn grouped(found: impl Iterator<Item = Found>) -> Vec<Reference> {
    let mut references = Vec::<Reference>::new();
    for Found { sample, known_mpa, is_simulated, bench, point } in found {
        let is_same = |known: &&mut Reference| {
            (known.sample.as_str(), known.known_mpa, known.is_simulated)
                == (sample.as_str(), known_mpa, is_simulated)
        };
        if references.last_mut().as_mut().is_none_or(|last| !is_same(last)) {
            let (reproducibility, charts) = (None, Vec::new());
            references.push(Reference { sample, known_mpa, is_simulated, reproducibility, charts });
        }
        let Some(reference) = references.last_mut() else { continue };
        match reference.charts.last_mut().filter(|chart| chart.bench == bench) {
            Some(chart) => chart.points.push(point),
            None => reference.charts.push(BenchChart { bench, points: vec![point] }),
        }
    }
    for reference in &mut references {
        let results = reference.charts.iter().map(BenchChart::values).collect::<Vec<_>>();
        reference.reproducibility = Reproducibility::of(&results);
        for chart in &mut reference.charts {
            chart.judge(LEAST_REL * reference.known_mpa);
        }
    }
    references
}

impl BenchChart {
    fn values(&self) -> Vec<f64> {
        self.points.iter().map(|point| point.stiffness_mpa).collect()
    }

    /// Compares each value with those before it.
    fn judge(&mut self, least_sigma: f64) {
        let mut chart = control::Chart::new(least_sigma);
        for point in &mut self.points {
            let Some(against) = chart.take(point.stiffness_mpa).against else { continue };
            let half = SCORE_LIMIT * against.sigma;
            point.limits_mpa = Some([against.mean - half, against.mean + half]);
            point.is_alarm = against.is_alarm();
        }
    }

    /// The chart for a page.
    pub(crate) fn panel(&self, known_mpa: f64) -> TrendPanel {
        let point = |point: &ChartPoint| TrendPoint {
            value: point.stiffness_mpa,
            made: point.started_at.clone(),
            limits: point.limits_mpa.map(|[low, high]| (low, high)),
            average: None,
            is_alarm: point.is_alarm,
        };
        TrendPanel {
            title: self.bench.clone(),
            unit: "MPa".to_owned(),
            least: LEAST_REL * known_mpa,
            each: "run",
            points: self.points.iter().map(point).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(sample: &str, bench: &str, stiffness_mpa: f64) -> Found {
        let point = ChartPoint {
            run_id: "run".to_owned(),
            started_at: "2026-11-26T08:00:00.000Z".to_owned(),
            stiffness_mpa,
            sigma_mpa: None,
            limits_mpa: None,
            is_alarm: false,
        };
        let (sample, bench) = (sample.to_owned(), bench.to_owned());
        Found { sample, known_mpa: 1.0, is_simulated: false, bench, point }
    }

    #[test]
    fn a_bench_that_changes_has_an_alarm_and_the_other_one_none() {
        let wobble = |run: u32| 1.0 + 0.01 * f64::from(run % 5);
        let steady = (0..30).map(|run| found("gel", "lab/left", wobble(run)));
        let changed = (0..30).map(|run| {
            let change = if run < 20 { 0.0 } else { 0.2 };
            found("gel", "lab/right", wobble(run) + change)
        });
        let other = [found("gum", "lab/left", 2.0)];
        let references = grouped(steady.chain(changed).chain(other));
        let [gel, gum] = &references[..] else { panic!("{references:?}") };
        assert_eq!((gel.charts.len(), gum.charts.len(), gum.reproducibility), (2, 1, None));
        let alarms = |chart: &BenchChart| chart.points.iter().position(|point| point.is_alarm);
        assert_eq!([alarms(&gel.charts[0]), alarms(&gel.charts[1])], [None, Some(20)]);
        assert!(gel.charts[0].points[..10].iter().all(|point| point.limits_mpa.is_none()));
        assert!(gel.charts[0].points[10..].iter().all(|point| point.limits_mpa.is_some()));
        assert_eq!(gel.reproducibility.unwrap().results, 60);
    }
}
