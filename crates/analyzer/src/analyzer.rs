//! An analyzer: identified, configured, and then asked for readings.

use rig_files::instrument::dialect::{CommandSet, Dialect};
use rig_link::{HealthMeter, Port, StopSignal, Transcript};
use rig_model::{DriveLevel, Reading, RigTime, SweepPoint};

use crate::{
    AnalyzerError, Identity, TransportSettings, instrument_port::InstrumentPort,
    point::TriggerSettings, trace,
};

/// Settling of a point that is begun again, s. What drove the sensor since the last reading is not known:
/// the instrument may have restarted with its own frequency. The sharpest sensor rings for some tenths of
/// a second.
const SETTLE_AGAIN_S: f64 = 2.0;

/// Longest accepted settling of a point, s.
const SETTLE_MAX_S: f64 = 60.0;

/// The most cycles that are integrated at a point.
const CYCLES_MAX: u32 = 100_000;

/// Largest number of measurements of a point that the instrument flags. A flag caused by a change
/// of range or a shock is absent at the next try; a lasting one has its cause on the bench.
const TRIES: usize = 3;

/// An impedance analyzer and its port.
///
/// ```text
///          ┌──────────────────── lost or unexpected answer ───────────────────┐
///          ▼                                                                  │
///   unsynchronised ── silence, no errors, same identity ──▶ synchronised ── level ──▶ set up
/// ```
#[derive(Debug)]
pub struct Analyzer {
    pub(crate) port: InstrumentPort,
    pub(crate) dialect: &'static Dialect,
    pub(crate) identity: Option<Identity>,
    /// Whether the instrument accepts several queries in one message; tested at the first contact.
    pub(crate) can_chain: Option<bool>,
    /// Whether it has the option that drives more.
    pub(crate) has_high_power: bool,
    /// Whether the next answer is known to belong to the next question.
    pub(crate) is_synchronised: bool,
    /// The level to measure at, and whether the instrument has it.
    pub(crate) level: Option<DriveLevel>,
    pub(crate) is_set_up: bool,
    /// The confirmed settings of the instrument.
    pub(crate) current: Option<TriggerSettings>,
    /// Time of the last change of frequency.
    pub(crate) frequency_set_at: RigTime,
    /// What each point of a trace takes beside its delay and cycles, s, at most.
    pub(crate) trace_overhead_s: f64,
}

impl Analyzer {
    /// An analyzer of this dialect at this port. Nothing is sent yet.
    pub fn open(port: Port, dialect: &'static Dialect) -> Self {
        Self::open_with(port, dialect, TransportSettings::default())
    }

    /// Opens an analyzer with other transport settings than those of its dialect.
    pub fn open_with(port: Port, dialect: &'static Dialect, settings: TransportSettings) -> Self {
        Self {
            port: InstrumentPort::new(port, &dialect.transport, settings),
            dialect,
            identity: None,
            can_chain: None,
            has_high_power: false,
            is_synchronised: false,
            level: None,
            is_set_up: false,
            current: None,
            frequency_set_at: RigTime::ZERO,
            trace_overhead_s: f64::INFINITY,
        }
    }

    /// The last frames of the port.
    pub fn transcript(&self) -> Transcript {
        self.port.link().transcript()
    }

    /// The counts of the instrument.
    pub fn health(&self) -> HealthMeter {
        self.port.health().clone()
    }

    /// Identifies the instrument.
    ///
    /// # Errors
    /// [`AnalyzerError::WrongInstrument`] when it is not one of this dialect,
    /// [`AnalyzerError::Swapped`] when it is not the one identified before.
    pub async fn identify(&mut self) -> Result<Identity, AnalyzerError> {
        self.is_synchronised = false;
        self.retry(async |this| this.synchronise().await).await
    }

    /// Prepares measurements at this level. Does nothing when they are prepared.
    ///
    /// # Errors
    /// [`AnalyzerError::OutOfRange`] for a level that the instrument cannot give; it was not sent
    /// then. [`AnalyzerError::Refused`], [`AnalyzerError::NotTaken`].
    pub async fn configure(&mut self, level: DriveLevel) -> Result<(), AnalyzerError> {
        if self.is_synchronised && self.is_set_up && self.level == Some(level) {
            return Ok(());
        }
        // The options are known after the identification.
        self.retry(async |this| this.synchronise().await).await?;
        let (min, max) = self.dialect.level_v;
        let high_power = self.dialect.high_power.as_ref().filter(|_| self.has_high_power);
        let max = high_power.map_or(max, |high_power| high_power.max_v);
        self.within("level in V", level.volt, (min, max))?;
        self.level = Some(level);
        self.is_set_up = false;
        let done = self.retry(async |this| this.set_up().await).await;
        if done.is_err() {
            self.level = None;
        }
        done
    }

    /// Measures at these points, in this order. A requested stop ends it between two points. A point
    /// that is begun again after a lost answer or a restart settles for at least two seconds.
    ///
    /// A flagged point is measured again, and its flagged readings come before the readings that
    /// follow. If the last try is flagged too, it is the last reading.
    ///
    /// # Errors
    /// [`AnalyzerError::Stopped`], [`AnalyzerError::NotConfigured`], [`AnalyzerError::OutOfRange`]
    /// before anything is sent, and the error of an answer that did not arrive at any try.
    pub async fn measure(
        &mut self,
        points: &[SweepPoint],
        stop: &StopSignal,
    ) -> Result<Vec<Reading>, AnalyzerError> {
        if self.level.is_none() {
            return Err(AnalyzerError::NotConfigured { port: self.port.name() });
        }
        let commands = &self.dialect.commands;
        let (settle_max_s, cycles_max) = match commands {
            CommandSet::Points(_) => (SETTLE_MAX_S, CYCLES_MAX),
            CommandSet::TraceE4990a => (trace::DELAY_MAX_S, trace::AVERAGES_MAX),
        };
        for point in points {
            self.within("frequency in Hz", point.frequency_hz, self.dialect.frequency_hz)?;
            self.within("settling in s", point.settle_s, (0.0, settle_max_s))?;
            self.within("cycles", point.cycles.into(), (1.0, cycles_max.into()))?;
        }
        let mut readings = Vec::with_capacity(points.len());
        let (mut done, mut tries) = (0, 0);
        while done < points.len() && tries < TRIES {
            let rest = &points[done..];
            let (mut first, mut is_again) = (rest[0], false);
            let more = if stop.is_raised() {
                Vec::new()
            } else {
                self.retry(async |this| {
                    let is_again = std::mem::replace(&mut is_again, true);
                    if is_again {
                        first.settle_s = first.settle_s.max(SETTLE_AGAIN_S);
                    }
                    match commands {
                        CommandSet::TraceE4990a if is_again => this.try_trace(&[first]).await,
                        CommandSet::TraceE4990a => this.try_trace(rest).await,
                        CommandSet::Points(commands) => {
                            this.try_point(commands, &first, stop).await
                        }
                    }
                })
                .await?
            };
            if more.is_empty() {
                return Err(AnalyzerError::Stopped { done, points: points.len() });
            }
            let is_sound = |one: &&Reading| one.flag().is_none();
            let sound = more.iter().take_while(is_sound).count();
            done += sound;
            tries = match sound {
                all if all == more.len() => 0,
                0 => tries + 1,
                _ => 1,
            };
            readings.extend(more.into_iter().take(sound + 1));
        }
        Ok(readings)
    }

    /// Measures at one point again and again until the stop is raised, and hands each reading over as it comes. A
    /// lost answer ends it: a question that is repeated comes too late.
    ///
    /// # Errors
    /// [`AnalyzerError::NotConfigured`], and the error of an answer that did not arrive.
    pub async fn stream(
        &mut self,
        point: &SweepPoint,
        stop: &StopSignal,
        mut take: impl FnMut(Reading),
    ) -> Result<(), AnalyzerError> {
        if self.level.is_none() {
            return Err(AnalyzerError::NotConfigured { port: self.port.name() });
        }
        self.within("frequency in Hz", point.frequency_hz, self.dialect.frequency_hz)?;
        let commands = &self.dialect.commands;
        while !stop.is_raised() {
            let readings = match commands {
                CommandSet::TraceE4990a => self.try_trace(&[*point]).await,
                CommandSet::Points(commands) => self.try_point(commands, point, stop).await,
            };
            // Its answers may come late, and it may have restarted with other settings.
            self.is_synchronised &= readings.is_ok();
            readings?.into_iter().for_each(&mut take);
        }
        Ok(())
    }

    fn within(
        &self,
        what: &'static str,
        asked: f64,
        (min, max): (f64, f64),
    ) -> Result<(), AnalyzerError> {
        if min <= asked && asked <= max {
            return Ok(());
        }
        let dialect = self.dialect.name.as_str();
        Err(AnalyzerError::OutOfRange { dialect, what, asked, min, max })
    }
}
