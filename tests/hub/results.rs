//! The results that the hub makes of its records, beside those of the journal.

use std::path::Path;

use rig_report::RunResults;
use rig_store::{Reader, RunKind};

use crate::support::Hub;

/// Stiffness of a sample, its standard deviation and the known one, MPa.
type Stiffness = (String, f64, Option<f64>, Option<f64>);

/// Has the hub judge its runs, and compares each sealed run of a journal with what its report says. Returns how many
/// stiffnesses were compared.
pub(crate) async fn compare(hub: &Hub, data: &Path) -> u64 {
    rig_hub::judge(&mut hub.another().await).await.unwrap();
    let reader = Reader::open(data).unwrap();
    let mut compared = 0;
    for run in reader.runs().unwrap() {
        if run.kind != RunKind::Run || !run.is_sealed {
            continue;
        }
        let results = RunResults::new(&run, &reader.amended(run.id).unwrap());
        let verdict = results.as_ref().ok().and_then(RunResults::model_verdict);
        let of_journal: Vec<Stiffness> = results
            .iter()
            .flat_map(|results| results.summary().stiffness)
            .filter_map(|of| Some((of.sample, of.stiffness_mpa?, of.sigma_mpa, of.known_mpa)))
            .collect();
        let id = run.id.to_string();
        let select =
            "SELECT model_verdict, reason IS NULL FROM hub.result WHERE run = $1::text::uuid";
        let judged = hub.admin.query_one(select, &[&id]).await.unwrap();
        assert_eq!(judged.get::<_, Option<&str>>(0), verdict, "verdict on the model of run {id}");
        assert_eq!(judged.get::<_, bool>(1), results.is_ok(), "run {id} has results");
        let select = "SELECT sample, stiffness_mpa, sigma_mpa, known_mpa FROM hub.stiffness
                      WHERE run = $1::text::uuid ORDER BY sample";
        let rows = hub.admin.query(select, &[&id]).await.unwrap();
        let of_hub = rows.iter().map(|row| (row.get(0), row.get(1), row.get(2), row.get(3)));
        let mut wanted = of_journal;
        wanted.sort_by(|one, other| one.0.cmp(&other.0));
        assert_eq!(of_hub.collect::<Vec<Stiffness>>(), wanted, "stiffness of run {id}");
        compared += wanted.len() as u64;
    }
    compared
}
