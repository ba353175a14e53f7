//! How fast the hub takes records and answers questions, on the computer at hand.

use std::{
    fmt,
    time::{Duration, Instant},
};

use clap::Args;
use rig_hub::{Catalogue, Identity, Wanted, connect};
use rig_store::{Reader, RunKind};
use tempfile::TempDir;
use tokio::task::JoinSet;

use crate::{
    copies::{Copier, Template},
    latency,
    support::{Hub, server},
    telling::Nats,
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
/// Numbers of runs from here on are those of rigs at real pace, and below it those of the backlog and the year.
const RIGS: u64 = 1 << 44;
/// How often each question is asked.
const ASKED: usize = 100;
/// Time of a rig of which it is measured when others see its records.
const SEEN_FOR: Duration = Duration::from_secs(120);

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
        add_results(&hub).await;
        questions(&hub, &format!("{} touches", whole_runs * touches as u64)).await;
        self.year(&hub, &template.thin()).await;
        let year_touches = (whole_runs + self.year_runs) * touches as u64;
        let title = format!("{year_touches} touches of {} runs", whole_runs + self.year_runs);
        questions(&hub, &title).await;
        let times_us = template.times_us();
        println!("a record of one rig at real pace is seen, after it is in the journal:");
        let nats = Nats::new(&hub).await;
        latency::print(&hub, &nats, "alone", &times_us, SEEN_FOR).await;
        self.real_pace(&hub, &nats, &template).await;
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
        add_results(hub).await;
        println!(
            "a year: {} runs of {YEAR_BENCHES} benches, made and shipped in {:.0} s",
            each * YEAR_BENCHES,
            began.elapsed().as_secs_f64()
        );
    }

    /// Lets many rigs record at the pace of the run, each at another place of it, under TLS.
    async fn real_pace(&self, hub: &Hub, nats: &Nats, template: &Template) {
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
        println!("the same while {} rigs record:", self.rigs);
        let times_us = template.times_us();
        let seen = latency::print(hub, nats, "beside", &times_us, SEEN_FOR.min(duration));
        let (recorded, ()) = tokio::join!(rigs.join_all(), seen);
        let seconds = began.elapsed().as_secs_f64();
        let sent: u64 = recorded.iter().map(|(_, sent)| sent).sum();
        let latencies: Vec<f32> =
            recorded.into_iter().flat_map(|(latencies, _)| latencies).collect();
        let rate = latencies.len() as f64 / seconds;
        let of_rigs = format!(
            "hub.record WHERE run IN (SELECT id FROM hub.run WHERE bench IN
             (SELECT id FROM hub.bench WHERE role::text LIKE '{}/rig-%'))",
            hub.database
        );
        let there = hub.count(&of_rigs).await.cast_unsigned();
        println!(
            "{} rigs at real pace for {} s: {rate:.0} records a second; from the journal until it is committed {}; a bench \
             collects for {} ms of these; {sent} records sent, {} of them not there, {} put aside",
            self.rigs,
            self.duration_s,
            Spread::of(latencies),
            TOGETHER.as_millis(),
            sent - there,
            hub.count("hub.clash").await
        );
    }
}

/// How values in ms lie.
pub(crate) struct Spread {
    mean: f32,
    median: f32,
    at_99: f32,
    longest: f32,
}

impl Spread {
    /// Of any number of values; NaN without one.
    pub(crate) fn of(mut ms: Vec<f32>) -> Self {
        ms.sort_by(f32::total_cmp);
        let sum: f64 = ms.iter().copied().map(f64::from).sum();
        #[expect(clippy::cast_possible_truncation, reason = "it is printed with one digit")]
        let mean = (sum / ms.len() as f64) as f32;
        let part = |hundredths: usize| {
            let place = ms.len().saturating_sub(1) * hundredths / 100;
            ms.get(place).copied().unwrap_or(f32::NAN)
        };
        Self { mean, median: part(50), at_99: part(99), longest: part(100) }
    }
}

impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { mean, median, at_99, longest } = self;
        write!(f, "mean {mean:.1}, median {median:.1}, 99 % {at_99:.1}, longest {longest:.1} ms")
    }
}

/// Gives each sealed run a verdict, of five runs three that hold, and a stiffness of each known sample.
async fn add_results(hub: &Hub) {
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
}

/// Records a run again and again, and returns for each record how long it took until it was committed, ms, and the
/// number of all that were sent.
async fn record(
    mut copier: Copier,
    template: Template,
    rig: u64,
    rigs: u32,
    duration: Duration,
) -> (Vec<f32>, u64) {
    let times_us = template.times_us();
    let lasts_us = times_us[times_us.len() - 1] + 1;
    let began = Instant::now();
    // Not all rigs are at the same place of their runs.
    let mut offset_us = lasts_us * rig / u64::from(rigs);
    let (mut latencies, mut number) = (Vec::new(), 0);
    while began.elapsed() < duration {
        let copy = template.copy(
            RIGS + (rig << 20) + number,
            &copier.journal,
            number * 1600,
            copier.event,
        );
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
            return (latencies, copier.event);
        }
        offset_us = 0;
    }
    (latencies, copier.event)
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
    println!("answers with {title}, of {ASKED} each:");
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
    println!(
        "  {name}: {}",
        Spread::of(times.iter().map(|time| time.as_secs_f32() * 1e3).collect())
    );
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
