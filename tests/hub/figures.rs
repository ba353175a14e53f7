//! How fast the hub takes records and answers questions, on the computer at hand.

use std::time::{Duration, Instant};

use clap::Args;
use rig_hub::{Catalogue, Identity, Wanted, connect};
use rig_store::{Reader, RunKind};
use tempfile::TempDir;
use tokio::task::JoinSet;

use crate::{
    copies::{Copier, Template},
    support::{Hub, server},
    worker,
};

#[derive(Debug, Args)]
pub(crate) struct FiguresArgs {
    /// Rigs at real pace
    #[arg(long, default_value_t = 500)]
    rigs: u32,
    /// How long they record, s
    #[arg(long, default_value_t = 3600)]
    duration_s: u32,
    /// Touches of whole runs, with all of their records
    #[arg(long, default_value_t = 20_000)]
    touches: usize,
    /// Runs of a year, with the records alone that have typed rows
    #[arg(long, default_value_t = 10_000)]
    year_runs: u64,
}

/// What is recorded within this time is sent together, as a bench does.
const TOGETHER: Duration = Duration::from_millis(200);
/// Benches of the year.
const YEAR_BENCHES: u64 = 20;
const YEAR_S: u64 = 365 * 86_400;
/// How often each question is asked.
const ASKED: usize = 20;

impl FiguresArgs {
    /// Prints all figures.
    pub(crate) async fn print(&self) {
        let mut hub = Hub::new().await;
        // Three connections of each bench may come together.
        let connections = self.rigs + 50;
        let set = format!("ALTER SYSTEM SET max_connections = {connections}");
        hub.admin.batch_execute(&set).await.unwrap();
        tokio::task::spawn_blocking(|| server().crash().unwrap()).await.unwrap();
        hub.reconnect().await;
        let (data, store) = (TempDir::new().unwrap(), TempDir::new().unwrap());
        worker::measure_paper(data.path()).await;
        let reader = Reader::open(data.path()).unwrap();
        let runs = reader.runs().unwrap();
        let run = runs.iter().find(|run| run.kind == RunKind::Run).unwrap();
        let template = Template::of(&reader, run);
        let touches = template.touches();
        println!("a run: {} records, {touches} touches", template.records());
        let object = object_bytes(data.path(), store.path());
        let whole_runs = self.touches.div_ceil(touches) as u64;
        self.backlog(&hub, &template, whole_runs, object).await;
        questions(&hub, &format!("{} touches", whole_runs * touches as u64)).await;
        self.year(&hub, &template.thin()).await;
        let year_touches = (whole_runs + self.year_runs) * touches as u64;
        let title = format!("{year_touches} touches of {} runs", whole_runs + self.year_runs);
        questions(&hub, &title).await;
        self.real_pace(&hub, &template).await;
    }

    /// Ships whole runs over one connection, and then over four.
    async fn backlog(&self, hub: &Hub, template: &Template, runs: u64, object_bytes: u64) {
        let before = size(hub).await;
        let (single, rest) = (runs / 4, runs - runs / 4);
        let one = ship_runs(hub, template, 0..1, single).await;
        let four = ship_runs(hub, template, 1..5, rest.div_ceil(4)).await;
        println!("backlog: {one:.0} records a second over one connection, {four:.0} over four");
        let shipped = single + 4 * rest.div_ceil(4);
        let in_hub = (size(hub).await - before) / shipped;
        println!(
            "bytes a run: {} of payloads in the journal, {in_hub} in PostgreSQL, {object_bytes} as an object",
            template.bytes()
        );
    }

    /// Ships the runs of a year, and gives each a result.
    async fn year(&self, hub: &Hub, thin: &Template) {
        let began = Instant::now();
        let mut benches = JoinSet::new();
        let each = self.year_runs.div_ceil(YEAR_BENCHES);
        for bench in 0..YEAR_BENCHES {
            let number = 1000 + bench;
            let role = hub.bench(&format!("year-{bench}")).await;
            let (client, thin) = (hub.as_role(&role).await, thin.clone());
            benches.spawn(async move {
                let mut copier = Copier::open(client, number).await;
                for run in 0..each {
                    let began_s = run * (YEAR_S / each) + bench * 60;
                    let id = number * 1_000_000 + run;
                    let copy = thin.copy(id, &copier.journal, began_s, copier.event);
                    copier.send(&copy, 0, thin.records()).await;
                }
            });
        }
        benches.join_all().await;
        let results = "
            INSERT INTO hub.result (run, model_verdict)
            SELECT id, (ARRAY['holds', 'holds', 'holds', 'strained', 'rejected'])[1 + abs(hashtext(id::text)) % 5]
            FROM hub.run WHERE kind = 'run' AND seal IS NOT NULL ON CONFLICT DO NOTHING;
            INSERT INTO hub.stiffness
            SELECT f.run, s.name, s.known_mpa * (1 + abs(hashtext(f.run::text)) % 1000 / 1e5), 0.01, s.known_mpa
            FROM hub.result AS f JOIN hub.sample AS s ON s.run = f.run WHERE s.known_mpa IS NOT NULL
            ON CONFLICT DO NOTHING;
            ANALYZE";
        hub.admin.batch_execute(results).await.unwrap();
        println!(
            "a year: {} runs of {YEAR_BENCHES} benches, made and shipped in {:.0} s",
            each * YEAR_BENCHES,
            began.elapsed().as_secs_f64()
        );
    }

    /// Lets many rigs record at the pace of the run, each at another place of it, under TLS.
    async fn real_pace(&self, hub: &Hub, template: &Template) {
        let mut rigs = JoinSet::new();
        let duration = Duration::from_secs(u64::from(self.duration_s));
        for rig in 0..u64::from(self.rigs) {
            let role = hub.bench(&format!("rig-{rig}")).await;
            let [certificate, key, authority] = server().certify(&role).unwrap();
            let identity = Identity::read(&certificate, &key, &authority).unwrap();
            let config = server().bench(&role, &hub.database);
            let (client, _task) = connect(&config, Some(&identity)).await.unwrap();
            let copier = Copier::open(client, 100_000 + rig).await;
            rigs.spawn(record(copier, template.clone(), rig, self.rigs, duration));
        }
        let began = Instant::now();
        let mut latencies = rigs.join_all().await.concat();
        let rate = latencies.len() as f64 / began.elapsed().as_secs_f64();
        latencies.sort_by(f32::total_cmp);
        let mean = latencies.iter().map(|ms| f64::from(*ms)).sum::<f64>() / latencies.len() as f64;
        let part = |hundredths: usize| latencies[(latencies.len() - 1) * hundredths / 100];
        println!(
            "{} rigs at real pace for {} s: {rate:.0} records a second; from the journal until it is committed {mean:.0} ms \
             in the mean, {:.0} ms in 99 of 100, {:.0} ms at most; a bench collects for {} ms of these",
            self.rigs,
            self.duration_s,
            part(99),
            part(100),
            TOGETHER.as_millis()
        );
    }
}

/// Records a run again and again, and returns for each record how long it took until it was committed, ms.
async fn record(
    mut copier: Copier,
    template: Template,
    rig: u64,
    rigs: u32,
    duration: Duration,
) -> Vec<f32> {
    let times_us = template.times_us();
    let lasts_us = times_us[times_us.len() - 1] + 1;
    let began = Instant::now();
    // Not all rigs are at the same place of their runs.
    let mut offset_us = lasts_us * rig / u64::from(rigs);
    let (mut latencies, mut number) = (Vec::new(), 0);
    while began.elapsed() < duration {
        let copy =
            template.copy((rig << 20) + number, &copier.journal, number * 1600, copier.event);
        number += 1;
        let run_began = Instant::now();
        let mut sent = times_us.partition_point(|time| *time < offset_us);
        copier.send(&copy, 0, sent).await;
        while sent < times_us.len() && began.elapsed() < duration {
            let due = Duration::from_micros(times_us[sent] - offset_us);
            tokio::time::sleep_until((run_began + due + TOGETHER).into()).await;
            let now_us = offset_us + micros(run_began.elapsed());
            let until = times_us.partition_point(|time| *time <= now_us);
            copier.send(&copy, sent, until).await;
            let done = offset_us + micros(run_began.elapsed());
            latencies.extend(times_us[sent..until].iter().map(|time| (done - time) as f32 / 1e3));
            sent = until;
        }
        if sent < times_us.len() {
            return latencies;
        }
        offset_us = 0;
    }
    latencies
}

fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap()
}

/// Ships so many runs of each bench, and returns the records a second.
async fn ship_runs(
    hub: &Hub,
    template: &Template,
    benches: std::ops::Range<u64>,
    runs: u64,
) -> f64 {
    let records = (benches.end - benches.start) * runs * template.records() as u64;
    let mut shipping = JoinSet::new();
    for bench in benches {
        let role = hub.bench(&format!("backlog-{bench}")).await;
        let (client, template) = (hub.as_role(&role).await, template.clone());
        shipping.spawn(async move {
            let mut copier = Copier::open(client, bench).await;
            for run in 0..runs {
                let number = (bench << 40) + run;
                let copy = template.copy(number, &copier.journal, run * 1600, copier.event);
                copier.send(&copy, 0, template.records()).await;
            }
        });
    }
    let began = Instant::now();
    shipping.join_all().await;
    records as f64 / began.elapsed().as_secs_f64()
}

/// Asks what the page asks, and prints how long each answer took.
async fn questions(hub: &Hub, title: &str) {
    let catalogue = Catalogue::new(server().admin(&hub.database));
    let text = str::to_owned;
    let searches = [
        ("the latest runs", Wanted::default()),
        ("search by sample", Wanted { sample: text("5"), ..Wanted::default() }),
        ("search by operator", Wanted { operator: text("ada"), ..Wanted::default() }),
        (
            "search by an operator who is not there",
            Wanted { operator: text("x"), ..Wanted::default() },
        ),
        ("search by verdict", Wanted { verdict: text("rejected"), ..Wanted::default() }),
        (
            "search by month",
            Wanted { from: text("2026-03"), until: text("2026-04"), ..Wanted::default() },
        ),
    ];
    println!("answers with {title}, of {ASKED} each, mean and longest:");
    let mut times = Vec::new();
    for _ in 0..ASKED {
        let began = Instant::now();
        catalogue.rigs().await.unwrap();
        times.push(began.elapsed());
    }
    told("the page of the rigs", &times);
    for (name, wanted) in searches {
        let mut times = Vec::new();
        for _ in 0..ASKED {
            let began = Instant::now();
            catalogue.runs(&wanted).await.unwrap();
            times.push(began.elapsed());
        }
        told(name, &times);
    }
    let mut times = Vec::new();
    for _ in 0..ASKED {
        let began = Instant::now();
        catalogue.references().await.unwrap();
        times.push(began.elapsed());
    }
    told("the comparison of benches", &times);
    let select = "SELECT sample, angle_deg, count(*), avg(shift_hz), stddev(shift_hz)
                  FROM hub.touch WHERE reason IS NULL GROUP BY sample, angle_deg";
    let mut times = Vec::new();
    for _ in 0..ASKED {
        let began = Instant::now();
        hub.admin.query(select, &[]).await.unwrap();
        times.push(began.elapsed());
    }
    told("mean and scatter of all shifts by sample and angle", &times);
}

fn told(name: &str, times: &[Duration]) {
    let ms: Vec<_> = times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
    let longest = ms.iter().copied().fold(0.0, f64::max);
    println!("  {name}: {:.1} ms, {longest:.1} ms", ms.iter().sum::<f64>() / ms.len() as f64);
}

/// Bytes of the database.
async fn size(hub: &Hub) -> u64 {
    let select = "SELECT pg_database_size(current_database())";
    hub.admin.query_one(select, &[]).await.unwrap().get::<_, i64>(0).cast_unsigned()
}

/// Bytes of the object of the run.
fn object_bytes(data: &std::path::Path, store: &std::path::Path) -> u64 {
    let put =
        worker::objects(data, store).unwrap().into_iter().map(|(_, put)| match put.unwrap() {
            rig_ship::Outcome::Shipped { object } => {
                std::fs::metadata(store.join(object)).unwrap().len()
            }
            other => panic!("{other:?}"),
        });
    put.max().unwrap()
}
