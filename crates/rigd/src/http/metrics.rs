//! `GET /metrics`: figures of the service for Prometheus, in the text form of `OpenMetrics`.
//!
//! They are made when they are asked for, from what the rig thread publishes and from the journal, so that
//! the rig thread does nothing for them.

mod happened;
mod no_load;

use std::sync::atomic::{AtomicU64, Ordering};

use axum::{
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};
use prometheus_client::{
    collector::Collector,
    encoding::{DescriptorEncoder, EncodeMetric, text::encode},
    metrics::{MetricType, counter::ConstCounter, gauge::ConstGauge},
    registry::Registry,
};
use rig_link::Durations;
use rig_store::{Ending, Reader};

pub(super) use happened::Happened;

use super::{Problem, Shared, tls::Tls};
use crate::{
    notify,
    rig::{Status, free_bytes},
};

const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
type Labels = Vec<(&'static str, String)>;

#[derive(Debug)]
enum Value {
    Count(u64),
    Gauge(f64),
    Durations(Durations),
}

/// A figure, with one value for each of its labels.
#[derive(Debug)]
struct Figure {
    name: &'static str,
    help: &'static str,
    values: Vec<(Labels, Value)>,
}

/// The figures of one request.
#[derive(Debug, Default)]
struct Figures(Vec<Figure>);

impl Figures {
    fn add(
        &mut self,
        name: &'static str,
        help: &'static str,
        values: impl IntoIterator<Item = (Labels, Value)>,
    ) {
        self.0.push(Figure { name, help, values: values.into_iter().collect() });
    }

    fn gauge(&mut self, name: &'static str, help: &'static str, value: f64) {
        self.add(name, help, [(Vec::new(), Value::Gauge(value))]);
    }

    fn count(&mut self, name: &'static str, help: &'static str, value: u64) {
        self.add(name, help, [(Vec::new(), Value::Count(value))]);
    }

    fn counts<'a>(
        &mut self,
        name: &'static str,
        help: &'static str,
        label: &'static str,
        counts: impl IntoIterator<Item = (&'a str, u64)>,
    ) {
        let values = counts
            .into_iter()
            .map(|(of, count)| (vec![(label, of.to_owned())], Value::Count(count)));
        self.add(name, help, values);
    }
}

impl Collector for Figures {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), std::fmt::Error> {
        for Figure { name, help, values } in &self.0 {
            let Some((_, first)) = values.first() else { continue };
            let kind = match first {
                Value::Count(_) => MetricType::Counter,
                Value::Gauge(_) => MetricType::Gauge,
                Value::Durations(_) => MetricType::Histogram,
            };
            let mut metric = encoder.encode_descriptor(name, help, None, kind)?;
            for (labels, value) in values {
                if labels.is_empty() {
                    match value {
                        Value::Count(count) => ConstCounter::new(*count).encode(metric)?,
                        Value::Gauge(value) => ConstGauge::new(*value).encode(metric)?,
                        Value::Durations(durations) => write(&mut metric, durations)?,
                    }
                    break;
                }
                let mut one = metric.encode_family(labels)?;
                match value {
                    Value::Count(count) => ConstCounter::new(*count).encode(one)?,
                    Value::Gauge(value) => ConstGauge::new(*value).encode(one)?,
                    Value::Durations(durations) => write(&mut one, durations)?,
                }
            }
        }
        Ok(())
    }
}

fn write(
    metric: &mut prometheus_client::encoding::MetricEncoder<'_>,
    durations: &Durations,
) -> Result<(), std::fmt::Error> {
    let bins: Vec<_> = durations.bins().collect();
    let (sum_s, count) = (durations.sum().as_secs_f64(), durations.count());
    metric.encode_histogram::<[(&str, &str); 0]>(sum_s, count, &bins, None)
}

/// The figures now.
pub(super) async fn show(State(shared): State<Shared>) -> Result<Response, Problem> {
    let status = shared.inner.rig.status().borrow().clone();
    let mut happened = shared.inner.happened.lock().await;
    let mut known = happened.clone();
    let first_event = status.first_event;
    let read = move |reader: &Reader| known.go_on(reader, first_event).map(|()| known);
    *happened = shared.read(read).await?;
    let mut figures = Figures::default();
    of_the_rig(&shared, &status, &mut figures);
    let (entries, missed, is_held) = shared.inner.queue.figures().await;
    figures.gauge("queue_entries", "Protocols that wait for the rig", entries as f64);
    figures.gauge("queue_missed", "Those that have missed their deadline", missed as f64);
    figures.gauge(
        "queue_held",
        "1 while no entry of the queue may begin",
        f64::from(u8::from(is_held)),
    );
    of_the_notifications(&shared, &mut figures);
    of_the_hub(&shared, &mut figures).await?;
    of_live_messages(&shared, &mut figures);
    of_the_devices(&status, &mut figures);
    of_the_journal(&happened, &mut figures);
    drop(happened);
    figures.counts(
        "runs_judged",
        "Endings of runs by whether the model behind their stiffness holds",
        "verdict",
        shared.inner.verdicts.read(),
    );
    let mut registry = Registry::with_prefix("rigd");
    registry.register_collector(Box::new(figures));
    let mut text = String::new();
    encode(&mut text, &registry).map_err(|_| Problem::internal("the figures cannot be written"))?;
    Ok(([(header::CONTENT_TYPE, OPEN_METRICS)], text).into_response())
}

fn of_the_rig(shared: &Shared, status: &Status, figures: &mut Figures) {
    let version = vec![("version", env!("CARGO_PKG_VERSION").to_owned())];
    figures.add("build", "Always 1; the version is a label", [(version, Value::Gauge(1.0))]);
    let state = vec![("state", status.snapshot.state.name().to_owned())];
    figures.add("state", "Always 1; the state of the rig is a label", [(state, Value::Gauge(1.0))]);
    let probe = vec![("probe", status.snapshot.clearance.name().to_owned())];
    figures.add(
        "probe",
        "Always 1; what is known of the probe is a label",
        [(probe, Value::Gauge(1.0))],
    );
    let is = |fact: bool| f64::from(u8::from(fact));
    figures.gauge(
        "latched",
        "1 while the rig is latched after a fault",
        is(status.snapshot.fault.is_some()),
    );
    figures.gauge(
        "silent",
        "1 while the rig loop gives no sign of life",
        is(status.silence.is_some()),
    );
    figures.gauge(
        "journal_failed",
        "1 when the journal cannot be written",
        is(status.journal_error.is_some()),
    );
    let is_asked = status.snapshot.prompt.is_some() || status.snapshot.refused.is_some();
    figures.gauge("waiting_for_a_person", "1 while the rig waits for an answer", is(is_asked));
    let run = status.run.as_ref().filter(|run| run.ending.is_none());
    let (planned, done) = run.map_or((0, 0), |run| (run.touches_planned(), run.touches_done));
    figures.gauge("run_touches_planned", "Touches of the run under way", planned as f64);
    figures.gauge("run_touches_done", "Touches of the run under way that are done", done as f64);
    if let Some(free_bytes) = free_bytes(&shared.inner.data) {
        figures.gauge("disk_free_bytes", "Free space for the data directory", free_bytes as f64);
    }
    let open = shared.inner.streams.taken();
    figures.gauge("event_streams", "Event streams that are open", open as f64);
    if let Some(expires) = shared.inner.tls.get().and_then(Tls::expires) {
        figures.gauge(
            "tls_certificate_expires_seconds",
            "When the certificate of the daemon expires, seconds since 1970",
            expires.as_second() as f64,
        );
    }
    let measured = status.setting.meters.read();
    let one = |durations| [(Vec::new(), Value::Durations(durations))];
    figures.add(
        "journal_commit_seconds",
        "Time until the disk has what was noted",
        one(measured.commits),
    );
    figures.add(
        "loop_late_seconds",
        "By how much the rig loop woke after its time",
        one(measured.late),
    );
}

fn of_the_devices(status: &Status, figures: &mut Figures) {
    let all = || {
        status
            .devices
            .iter()
            .map(|device| (vec![("device", device.role.to_owned())], device.health.read()))
    };
    let mut count = |name, help, of: fn(&rig_link::Health) -> u64| {
        figures.add(name, help, all().map(|(labels, health)| (labels, Value::Count(of(&health)))));
    };
    count("device_requests", "Requests carried out or tried", |health| health.requests);
    count("device_retries", "Attempts that were repeated", |health| health.retries);
    count("device_late", "Answers that did not come in time", |health| health.late);
    count("device_corrupt", "Answers that could not be read", |health| health.corrupt);
    count("device_refusals", "Requests that the device refused", |health| health.refusals);
    count("device_faults", "Requests that failed in spite of all attempts", |health| health.faults);
    let round_trips = all().map(|(labels, health)| (labels, Value::Durations(health.round_trips)));
    let help = "From sending a request to the end of its answer, on the rig's clock";
    figures.add("device_round_trip_seconds", help, round_trips);
}

fn of_the_notifications(shared: &Shared, figures: &mut Figures) {
    let Some(post) = shared.notifications() else { return };
    let all = post.figures();
    let labels = |target: &String| vec![("target", target.clone())];
    let waiting = all.iter().map(|(target, of)| (labels(target), Value::Gauge(of.waiting as f64)));
    figures.add("notifications_waiting", "Messages in the outbox, by target", waiting);
    let mut count = |name, help, of: fn(&notify::Figures) -> u64| {
        let counts = all.iter().map(|(target, counts)| (labels(target), Value::Count(of(counts))));
        figures.add(name, help, counts);
    };
    count("notifications_sent", "Messages that were sent", |of| of.sent);
    count("notifications_failed", "Attempts that failed", |of| of.failed);
    count(
        "notifications_given_up",
        "Messages that were tried often enough, or for which there was no room",
        |of| of.given_up,
    );
}

/// How far the hub is behind the journal.
async fn of_the_hub(shared: &Shared, figures: &mut Figures) -> Result<(), Problem> {
    let Some(standing) = shared.inner.shipping.get() else { return Ok(()) };
    let standing = standing.borrow().clone();
    let last_event = shared.read(|reader| Ok(reader.last_event()?)).await?;
    let is_connected = f64::from(u8::from(standing.is_connected));
    figures.gauge("hub_connected", "1 while the hub answers", is_connected);
    let behind = last_event.saturating_sub(standing.event);
    figures.gauge("hub_events_behind", "Events that the hub has not committed", behind as f64);
    let help = "Records that the hub has committed since the start";
    figures.count("hub_records", help, standing.records);
    figures.count("hub_failures", "Attempts to ship that failed", standing.failures);
    Ok(())
}

/// What viewers are told by NATS.
fn of_live_messages(shared: &Shared, figures: &mut Figures) {
    let Some(standing) = shared.inner.live.get() else { return };
    let standing = standing.borrow().clone();
    let is_connected = f64::from(u8::from(standing.is_connected));
    figures.gauge("live_connected", "1 while the nats-server answers", is_connected);
    figures.count("live_messages", "Messages that were sent to viewers", standing.messages);
    let help = "Events that viewers were not told, without a connection or because of their number or size";
    figures.count("live_left_out", help, standing.left_out);
    figures.count("live_failures", "Attempts to tell viewers that failed", standing.failures);
}

fn of_the_journal(happened: &Happened, figures: &mut Figures) {
    figures.count("touches_measured", "Touches with a frequency shift", happened.measured);
    let refused = happened.refused.iter().map(|(reason, count)| (reason.as_str(), *count));
    figures.counts("touches_refused", "Touches without one, by reason", "reason", refused);
    let sweeps = happened.sweeps.iter().map(|(outcome, count)| (*outcome, *count));
    figures.counts("sweeps", "Sweeps by outcome", "outcome", sweeps);
    // Those that have not come are 0: what appears with its first event has no increase.
    let count = |ending: Ending| happened.runs.get(ending.name()).copied().unwrap_or(0);
    let runs = Ending::ALL.map(|ending| (ending.name(), count(ending)));
    figures.counts("runs_ended", "Runs and sessions by their ending", "ending", runs);
    figures.count("faults", "Faults that latched the rig", happened.faults);
    figures.count("hold_ups", "Times the program or the computer was held up", happened.stalls);
    if let Some((resonance_hz, sigma_hz)) = happened.resonance_hz {
        figures.gauge("resonance_hertz", "The last accepted resonance", resonance_hz);
        figures.gauge("resonance_sigma_hertz", "Its standard deviation", sigma_hz);
    }
    let Some(no_load) = &happened.no_load else { return };
    let last = no_load.last();
    let help = "The last accepted resonance of the sensor without a sample";
    figures.gauge("no_load_resonance_hertz", help, last.resonance_hz);
    figures.gauge("no_load_resonance_sigma_hertz", "Its standard deviation", last.sigma_hz);
    if let Some(quality_factor) = last.quality_factor {
        figures.gauge("no_load_quality_factor", "Its quality factor", quality_factor);
    }
    let help = "How far it is above the first one since the daemon was started";
    figures.gauge("no_load_drift_hertz", help, no_load.drift_hz());
}

/// Endings of runs by the verdict on their model, since the daemon was started.
#[derive(Debug, Default)]
pub(super) struct Verdicts([AtomicU64; VERDICTS.len()]);

/// The words of [`rig_report::RunResults::model_verdict`].
const VERDICTS: [&str; 3] = ["holds", "strained", "rejected"];

impl Verdicts {
    /// Each word with its count, also those that have not come.
    fn read(&self) -> impl Iterator<Item = (&'static str, u64)> {
        VERDICTS.into_iter().zip(self.0.iter().map(|count| count.load(Ordering::Relaxed)))
    }
}

impl Shared {
    /// Counts the verdict on the model of a run that has ended.
    pub(crate) fn count_verdict(&self, verdict: &str) {
        let at = VERDICTS.into_iter().position(|word| word == verdict);
        if let Some(count) = at.and_then(|at| self.inner.verdicts.0.get(at)) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }
}
