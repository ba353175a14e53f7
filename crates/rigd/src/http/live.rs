//! Events that are not in the journal: changes of the rig, and the current sweep.
//!
//! Two kinds of events, without an id. `rig` has the content of `GET /api/v1/rig`; it comes at
//! least once a second, so that a client can detect a lost connection. `live_sweep` has the
//! readings since the previous event. Both describe states, not changes: a slow client gets fewer
//! events and misses nothing.
//!
//! The streams send moments of the rig that they share, so that a moment is encoded once, however many
//! streams there are.

use std::{
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use axum::body::Bytes;
use futures_util::{Stream, stream};
use rig_model::Reading;
use rig_resonance::Circuit;
use serde::Serialize;
use tokio::{sync::watch, time::Instant};

use super::{Shared, events::encoded, rig};
use crate::{
    rig::{LiveEstimate, LiveSweep, Status},
    rig_view::EstimateView,
};

/// A client sees a change after this time at most, and no more events than one in this time.
pub(super) const INTERVAL: Duration = Duration::from_millis(40);
/// Live events that all streams together get in a second. From 41 streams on each gets fewer.
const EVENTS_PER_S: f64 = 1024.0;
/// An event comes after this time, also when nothing changes.
pub(super) const HEARTBEAT: Duration = Duration::from_secs(1);
/// Parts of a sweep that a moment keeps. Streams of the same pace ask for the same ones.
const PARTS_MAX: usize = 64;

/// The rig at one moment, as the streams send it.
#[derive(Debug)]
pub(super) struct Moment {
    status: Status,
    rig: OnceLock<Option<Bytes>>,
    /// Parts of the sweep from these indices to the end, encoded.
    parts: Mutex<Vec<([usize; 2], Bytes)>>,
}

impl Moment {
    pub(super) const fn new(status: Status) -> Self {
        Self { status, rig: OnceLock::new(), parts: Mutex::new(Vec::new()) }
    }

    /// The event of the rig.
    fn rig(&self, shared: &Shared) -> Option<Bytes> {
        self.rig.get_or_init(|| event("rig", &rig::view(shared, &self.status))).clone()
    }

    /// The event of the sweep from these indices on.
    fn part(&self, live: &LiveSweep, from: [usize; 2]) -> Option<Bytes> {
        // Parts are complete even after a panic.
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, part)) = parts.iter().find(|(begin, _)| *begin == from) {
            return Some(part.clone());
        }
        let part = event("live_sweep", &LiveView::of(live, from))?;
        if parts.len() < PARTS_MAX {
            parts.push((from, part.clone()));
        }
        Some(part)
    }
}

/// A sweep as far as it has come since the last event.
#[derive(Debug, Serialize)]
struct LiveView {
    /// Counts the sweeps since the daemon was started.
    sweep: u64,
    /// `no_load`, `touch` or `manual`.
    purpose: &'static str,
    min_hz: f64,
    max_hz: f64,
    target_sigma_hz: f64,
    time_limit_s: f64,
    /// Index of the first reading and of the first estimate in this event.
    from: [usize; 2],
    readings: Vec<ReadingView>,
    estimates: Vec<EstimateView>,
    #[serde(skip_serializing_if = "Option::is_none")]
    circuit: Option<CircuitView>,
}

#[derive(Debug, Serialize)]
struct ReadingView {
    frequency_hz: f64,
    resistance_ohm: f64,
    reactance_ohm: f64,
    started_s: f64,
    settle_s: f64,
    integration_s: f64,
}

/// The circuit in the terms of the journal.
#[derive(Debug, Serialize)]
struct CircuitView {
    resonance_hz: f64,
    quality_factor: f64,
    static_capacitance_f: f64,
    capacitance_ratio: f64,
    loss_tangent: f64,
}

/// The position of a stream of live events.
struct Cursor {
    shared: Shared,
    moments: watch::Receiver<Arc<Moment>>,
    /// When the last event was sent.
    sent: Option<Instant>,
    /// The sweep that is being sent, and how much of it has been.
    sweep: u64,
    from: [usize; 2],
    /// The event that follows that of the rig.
    next: Option<Bytes>,
    watcher: Watcher,
}

/// Counts a stream of live events while it is open.
struct Watcher(Arc<AtomicUsize>);

impl Watcher {
    fn new(all: &Arc<AtomicUsize>) -> Self {
        all.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(all))
    }

    /// The time between two events of a stream.
    fn interval(&self) -> Duration {
        let all = self.0.load(Ordering::Relaxed);
        INTERVAL.max(Duration::from_secs_f64(all as f64 / EVENTS_PER_S))
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

pub(super) fn stream(
    shared: Shared,
    moments: watch::Receiver<Arc<Moment>>,
) -> impl Stream<Item = Bytes> {
    let watcher = Watcher::new(&shared.inner.watching);
    let cursor =
        Cursor { shared, moments, sent: None, sweep: 0, from: [0, 0], next: None, watcher };
    stream::unfold(cursor, |mut cursor| async move {
        let event = cursor.next().await?;
        Some((event, cursor))
    })
}

impl Cursor {
    /// The next event; none when the rig has gone.
    async fn next(&mut self) -> Option<Bytes> {
        if let Some(event) = self.next.take() {
            return Some(event);
        }
        let sent = self.sent;
        if let Some(sent) = sent {
            self.moments.changed().await.ok()?;
            tokio::time::sleep_until(sent + self.watcher.interval()).await;
        }
        let shared = Arc::clone(&self.moments.borrow_and_update());
        // A shared moment may be older than the command that a client has given before it opens a stream.
        let moment = if sent.is_none() {
            Arc::new(Moment::new(self.shared.inner.rig.status().borrow().clone()))
        } else {
            shared
        };
        self.sent = Some(Instant::now());
        self.next = self.news(&moment);
        moment.rig(&self.shared)
    }

    /// The part of a sweep since the last event.
    fn news(&mut self, moment: &Moment) -> Option<Bytes> {
        let live = moment.status.live.as_ref()?;
        let (from, to) = (self.from, [live.readings.len(), live.estimates.len()]);
        let from = if self.sweep == live.serial { from } else { [0, 0] };
        if (self.sweep, from) == (live.serial, to) {
            return None;
        }
        (self.sweep, self.from) = (live.serial, to);
        moment.part(live, from)
    }
}

impl LiveView {
    fn of(live: &LiveSweep, from: [usize; 2]) -> Self {
        Self {
            sweep: live.serial,
            purpose: live.purpose.name(),
            min_hz: live.request.window.min_hz,
            max_hz: live.request.window.max_hz,
            target_sigma_hz: live.request.target_sigma_hz,
            time_limit_s: live.request.time_limit_s,
            from,
            readings: live.readings[from[0]..].iter().filter_map(ReadingView::of).collect(),
            estimates: live.estimates[from[1]..].iter().map(EstimateView::of).collect(),
            circuit: live.circuit.as_ref().map(CircuitView::of),
        }
    }
}

/// An event with JSON in it.
fn event(name: &str, view: &impl Serialize) -> Option<Bytes> {
    Some(encoded(None, name, &serde_json::to_string(view).ok()?))
}

impl ReadingView {
    /// A reading, unless it has no value.
    fn of(reading: &Reading) -> Option<Self> {
        let impedance = reading.impedance()?;
        Some(Self {
            frequency_hz: reading.frequency_hz,
            resistance_ohm: impedance.resistance_ohm,
            reactance_ohm: impedance.reactance_ohm,
            started_s: reading.started.as_seconds(),
            settle_s: reading.settle_s,
            integration_s: reading.integration_s,
        })
    }
}

impl EstimateView {
    const fn of(estimate: &LiveEstimate) -> Self {
        let LiveEstimate { readings, resonance_hz, sigma_hz } = *estimate;
        Self { readings, resonance_hz, sigma_hz }
    }
}

impl CircuitView {
    fn of(circuit: &Circuit) -> Self {
        Self {
            resonance_hz: circuit.resonance_hz,
            quality_factor: circuit.q,
            static_capacitance_f: circuit.c0_farad,
            capacitance_ratio: circuit.c1_farad / circuit.c0_farad,
            loss_tangent: circuit.loss_tangent,
        }
    }
}
