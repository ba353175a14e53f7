//! Events that are not in the journal: changes of the rig, and the current sweep.
//!
//! Two kinds of events, without an id. `rig` has the content of `GET /api/v1/rig`; it comes at
//! least once a second, so that a client can detect a lost connection. `live_sweep` has the
//! readings since the previous event. Both describe states, not changes: a slow client gets fewer
//! events and misses nothing.

use std::{
    sync::{
        Arc,
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
const INTERVAL: Duration = Duration::from_millis(40);
/// Live events that all streams together get in a second. From 41 streams on each gets fewer.
const EVENTS_PER_S: f64 = 1024.0;
/// An event comes after this time, also when nothing changes.
const HEARTBEAT: Duration = Duration::from_secs(1);

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
    status: watch::Receiver<Status>,
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

pub(super) fn stream(shared: Shared, status: watch::Receiver<Status>) -> impl Stream<Item = Bytes> {
    let watcher = Watcher::new(&shared.inner.watching);
    let cursor = Cursor { shared, status, sent: None, sweep: 0, from: [0, 0], next: None, watcher };
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
        if let Some(sent) = self.sent {
            tokio::select! {
                changed = self.status.changed() => changed.ok()?,
                () = tokio::time::sleep_until(sent + HEARTBEAT) => {}
            }
            tokio::time::sleep_until(sent + self.watcher.interval()).await;
        }
        let status = self.status.borrow_and_update().clone();
        self.sent = Some(Instant::now());
        self.next = status.live.as_ref().and_then(|live| self.news(live));
        event("rig", &rig::view(&self.shared, &status))
    }

    /// The part of a sweep since the last event.
    fn news(&mut self, live: &Arc<LiveSweep>) -> Option<Bytes> {
        if self.sweep != live.serial {
            (self.sweep, self.from) = (live.serial, [0, 0]);
        } else if self.from == [live.readings.len(), live.estimates.len()] {
            return None;
        }
        let view = LiveView {
            sweep: live.serial,
            purpose: live.purpose.name(),
            min_hz: live.request.window.min_hz,
            max_hz: live.request.window.max_hz,
            target_sigma_hz: live.request.target_sigma_hz,
            time_limit_s: live.request.time_limit_s,
            from: self.from,
            readings: live.readings[self.from[0]..].iter().filter_map(ReadingView::of).collect(),
            estimates: live.estimates[self.from[1]..].iter().map(EstimateView::of).collect(),
            circuit: live.circuit.as_ref().map(CircuitView::of),
        };
        self.from = [live.readings.len(), live.estimates.len()];
        event("live_sweep", &view)
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
