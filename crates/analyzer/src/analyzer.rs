//! An analyzer: identified, configured, and then asked for readings.

use std::time::Duration;

use rig_link::{Port, StopSignal, Transcript};
use rig_model::{DriveLevel, Reading, RigTime, SweepPoint};

use crate::{
    AnalyzerError, Dialect, EventStatus, Identity,
    answer::{Impedance, real},
    hioki,
    wire::{ANSWER_WITHIN, Answered, Wire},
};

/// How often a measurement is begun anew after its answer was lost.
const ATTEMPTS: u32 = 3;

/// How long the line is only listened to after a lost answer.
const QUARANTINE: Duration = Duration::from_millis(500);

/// The instrument may take this much longer than delay and integration: it ranges, computes and
/// formats.
const MEASURE_SLACK: Duration = Duration::from_secs(1);

/// Integration may take this many times the cycles asked for while the range is sought.
const MEASURE_TIMES: f64 = 3.0;

/// How far the level that the instrument reports may be from the one asked for: it prints three
/// digits.
const LEVEL_TOLERANCE_REL: f64 = 0.005;

/// An impedance analyzer and its port.
///
/// ```text
///          ┌────────────────── lost or strange answer ──────────────────┐
///          ▼                                                            │
///   out of step ── silence, no errors, same identity ──▶ in step ── level ──▶ set up
/// ```
#[derive(Debug)]
pub struct Analyzer {
    wire: Wire,
    dialect: &'static Dialect,
    identity: Option<Identity>,
    /// Whether several questions may stand in one message; found out at the first greeting.
    can_chain: Option<bool>,
    /// Whether the next answer is known to belong to the next question.
    is_in_step: bool,
    /// The level to measure at, and whether the instrument has it.
    level: Option<DriveLevel>,
    is_set_up: bool,
    /// What the instrument is set to, as far as it has confirmed.
    current: Option<SweepPoint>,
    /// When its frequency was last set.
    frequency_set_at: RigTime,
}

impl Analyzer {
    /// An analyzer of this dialect at this port. Nothing is sent yet.
    pub fn open(port: Port, dialect: &'static Dialect) -> Self {
        Self {
            wire: Wire::new(port, dialect.quirks),
            dialect,
            identity: None,
            can_chain: None,
            is_in_step: false,
            level: None,
            is_set_up: false,
            current: None,
            frequency_set_at: RigTime::ZERO,
        }
    }

    /// What the instrument is known to be.
    pub const fn dialect(&self) -> &'static Dialect {
        self.dialect
    }

    /// The last frames of the port.
    pub fn transcript(&self) -> Transcript {
        self.wire.port().transcript()
    }

    /// Finds out who answers.
    ///
    /// # Errors
    /// [`AnalyzerError::WrongInstrument`] when it is not one of this dialect,
    /// [`AnalyzerError::Swapped`] when it is not the one identified before.
    pub async fn identify(&mut self) -> Result<Identity, AnalyzerError> {
        self.is_in_step = false;
        self.persist(async |this| this.get_in_step().await).await
    }

    /// Prepares measurements at this level.
    ///
    /// # Errors
    /// [`AnalyzerError::OutOfRange`] for a level that the instrument cannot give; nothing was sent
    /// then. [`AnalyzerError::Refused`], [`AnalyzerError::NotTaken`].
    pub async fn configure(&mut self, level: DriveLevel) -> Result<(), AnalyzerError> {
        self.within("level in V", level.volt, self.dialect.level_v)?;
        self.level = Some(level);
        self.is_set_up = false;
        let done = self.persist(async |this| this.get_set_up().await).await;
        if done.is_err() {
            self.level = None;
        }
        done
    }

    /// Measures at these points, in this order. Ends between two points when a stop is asked for.
    ///
    /// # Errors
    /// [`AnalyzerError::Stopped`], [`AnalyzerError::NotConfigured`],
    /// [`AnalyzerError::OutOfRange`] before anything is sent, and what a lost answer led to when
    /// it stayed lost.
    pub async fn measure(
        &mut self,
        points: &[SweepPoint],
        stop: &StopSignal,
    ) -> Result<Vec<Reading>, AnalyzerError> {
        if self.level.is_none() {
            return Err(AnalyzerError::NotConfigured { port: self.wire.name() });
        }
        for point in points {
            self.within("frequency in Hz", point.frequency_hz, self.dialect.frequency_hz)?;
            let delay_max_s = self.dialect.trigger_delay_max_s;
            self.within("settling in s", point.settle_s, (0.0, delay_max_s))?;
            let averages_max = f64::from(self.dialect.averages_max);
            self.within("cycles", f64::from(point.cycles), (1.0, averages_max))?;
        }
        let mut readings = Vec::with_capacity(points.len());
        for point in points {
            if stop.is_raised() {
                let (done, points) = (readings.len(), points.len());
                return Err(AnalyzerError::Stopped { done, points });
            }
            let reading = self.persist(async |this| this.try_point(point).await).await?;
            readings.push(reading);
        }
        Ok(readings)
    }

    async fn try_point(&mut self, point: &SweepPoint) -> Result<Reading, AnalyzerError> {
        self.get_set_up().await?;
        let step = self.dialect.frequency_step_hz;
        // What the instrument will round to, so that it can be compared with what it says.
        let frequency_hz = (point.frequency_hz / step).round() * step;
        let point = SweepPoint { frequency_hz, ..*point };
        let is_new_frequency =
            self.current.is_none_or(|current| current.frequency_hz != frequency_hz);
        let mut message = hioki::settings(&point, self.current.as_ref());
        // Until it has confirmed, nothing is known about its settings.
        self.current = None;
        message.push(hioki::TRIGGER.to_owned());
        let integration_s = f64::from(point.cycles) / frequency_hz;
        let within =
            MEASURE_SLACK + Duration::from_secs_f64(point.settle_s + MEASURE_TIMES * integration_s);
        let message = message.join(";");
        let asked = self.ask_all(&message, within).await?;
        let [reading, frequency, status] = &asked.answers;
        let status = self.event_status(&message, status)?;
        if status.is_power_on() || status.is_error() {
            return Err(self.refused(&message, status));
        }
        let found = self.number(hioki::FREQUENCY_QUERY, frequency)?;
        if (found - frequency_hz).abs() > 0.5 * step {
            let port = self.wire.name();
            let what = "frequency in Hz";
            return Err(AnalyzerError::NotTaken { port, what, wanted: frequency_hz, found });
        }
        let Some(impedance) = hioki::reading(reading) else {
            return Err(self.wire.unexpected(&message, hioki::READING, reading.as_bytes()));
        };
        if is_new_frequency {
            self.frequency_set_at = asked.at;
        }
        self.current = Some(point);
        let Impedance { resistance_ohm, reactance_ohm, flag } = impedance;
        let waited = asked.at.since(self.frequency_set_at).as_secs_f64();
        Ok(Reading {
            frequency_hz: found,
            resistance_ohm,
            reactance_ohm,
            started: self.frequency_set_at,
            settle_s: waited + point.settle_s,
            integration_s,
            flag,
        })
    }

    /// Measures, and asks for frequency and status behind it, in one message where the instrument
    /// can take that.
    async fn ask_all(&mut self, message: &str, within: Duration) -> Result<Asked, AnalyzerError> {
        if self.can_chain == Some(true) {
            let chain = format!("{message};{};*ESR?", hioki::FREQUENCY_QUERY);
            let Answered { text, asked_at } = self.wire.ask(&chain, within).await?;
            let fields: Vec<String> = text.split(';').map(str::to_owned).collect();
            let Ok(answers) = <[String; 3]>::try_from(fields) else {
                return Err(self.wire.unexpected(&chain, "three answers", text.as_bytes()));
            };
            return Ok(Asked { answers, at: asked_at });
        }
        let Answered { text: reading, asked_at } = self.wire.ask(message, within).await?;
        let frequency = self.wire.ask(hioki::FREQUENCY_QUERY, ANSWER_WITHIN).await?.text;
        let status = self.wire.ask("*ESR?", ANSWER_WITHIN).await?.text;
        Ok(Asked { answers: [reading, frequency, status], at: asked_at })
    }

    /// Does it again from its beginning while the trouble is one that passes.
    async fn persist<T>(
        &mut self,
        mut what: impl AsyncFnMut(&mut Self) -> Result<T, AnalyzerError>,
    ) -> Result<T, AnalyzerError> {
        let mut attempts = 0;
        loop {
            attempts += 1;
            match what(self).await {
                Ok(done) => return Ok(done),
                Err(error) if !is_passing(&error) => return Err(error),
                Err(error) => {
                    self.is_in_step = false;
                    if attempts == ATTEMPTS {
                        return Err(self.explain(error).await);
                    }
                    tracing::warn!(%error, attempts, "beginning again");
                }
            }
        }
    }

    /// An instrument that ignores the rest of a message after an error in it stays silent. It is
    /// asked whether that was so.
    async fn explain(&mut self, error: AnalyzerError) -> AnalyzerError {
        let AnalyzerError::Line { asked, .. } = &error else { return error };
        if self.wire.quarantine(QUARANTINE).await.is_err() {
            return error;
        }
        match self.wire.ask("*ESR?", ANSWER_WITHIN).await {
            Ok(answered) => match self.event_status("*ESR?", &answered.text) {
                Ok(status) if status.is_error() => self.refused(asked, status),
                _ => error,
            },
            Err(_) => error,
        }
    }

    /// Finds a common footing: silence, no old errors, the instrument that is expected.
    async fn get_in_step(&mut self) -> Result<Identity, AnalyzerError> {
        if let (true, Some(identity)) = (self.is_in_step, &self.identity) {
            return Ok(identity.clone());
        }
        self.is_set_up = false;
        self.wire.quarantine(QUARANTINE).await?;
        let greeting: Vec<&str> =
            self.dialect.quirks.header_off.into_iter().chain(["*CLS", "*IDN?"]).collect();
        let greeting = greeting.join(";");
        let Answered { text, .. } = self.wire.ask(&greeting, ANSWER_WITHIN).await?;
        let Some(found) = Identity::parse(&text) else {
            return Err(self.wire.unexpected(&greeting, "an identity", text.as_bytes()));
        };
        let (port, expected) = (self.wire.name(), self.dialect.models);
        if !self.dialect.model_prefixes.iter().any(|prefix| found.model.starts_with(prefix)) {
            let found = Box::new(found);
            return Err(AnalyzerError::WrongInstrument { port, expected, found });
        }
        if let Some(known) = self.identity.as_ref().filter(|known| **known != found) {
            let (known, found) = (Box::new(known.clone()), Box::new(found));
            return Err(AnalyzerError::Swapped { port, known, found });
        }
        if self.can_chain.is_none() {
            self.can_chain = Some(self.try_chain().await?);
        }
        self.identity = Some(found.clone());
        self.is_in_step = true;
        Ok(found)
    }

    /// Whether two questions in one message get two answers in one line.
    async fn try_chain(&mut self) -> Result<bool, AnalyzerError> {
        match self.wire.ask("*ESR?;*ESR?", ANSWER_WITHIN).await {
            Ok(answered) if answered.text == "0;0" => return Ok(true),
            Ok(_) => {}
            Err(error) if is_passing(&error) => {}
            Err(error) => return Err(error),
        }
        self.wire.quarantine(QUARANTINE).await?;
        // The attempt was an error where it is not allowed.
        let answered = self.wire.ask("*ESR?", ANSWER_WITHIN).await?;
        self.event_status("*ESR?", &answered.text)?;
        Ok(false)
    }

    /// Gives the instrument its settings, if it has lost them or never had them.
    async fn get_set_up(&mut self) -> Result<(), AnalyzerError> {
        self.get_in_step().await?;
        let Some(level) = self.level else {
            return Err(AnalyzerError::NotConfigured { port: self.wire.name() });
        };
        if self.is_set_up {
            return Ok(());
        }
        self.current = None;
        for message in hioki::setup(level) {
            // The question behind it tells a message that was lost from one that was heard.
            let message = format!("{message};*ESR?");
            let answered = self.wire.ask(&message, ANSWER_WITHIN).await?;
            let status = self.event_status(&message, &answered.text)?;
            if status.is_error() || status.is_power_on() {
                return Err(self.refused(&message, status));
            }
        }
        let answered = self.wire.ask(hioki::LEVEL_QUERY, ANSWER_WITHIN).await?;
        let found = self.number(hioki::LEVEL_QUERY, &answered.text)?;
        if (found - level.volt).abs() > LEVEL_TOLERANCE_REL * level.volt {
            let (port, wanted) = (self.wire.name(), level.volt);
            return Err(AnalyzerError::NotTaken { port, what: "level in V", wanted, found });
        }
        self.is_set_up = true;
        Ok(())
    }

    fn event_status(&self, asked: &str, answer: &str) -> Result<EventStatus, AnalyzerError> {
        let status = answer.trim().parse().map(EventStatus);
        status.map_err(|_| self.wire.unexpected(asked, "an event status", answer.as_bytes()))
    }

    fn number(&self, asked: &str, answer: &str) -> Result<f64, AnalyzerError> {
        real(answer.trim())
            .ok_or_else(|| self.wire.unexpected(asked, "a number", answer.as_bytes()))
    }

    fn refused(&self, asked: &str, status: EventStatus) -> AnalyzerError {
        AnalyzerError::Refused { port: self.wire.name(), asked: asked.into(), status }
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
        let dialect = self.dialect.name;
        Err(AnalyzerError::OutOfRange { dialect, what, asked, min, max })
    }
}

/// The answers to a measurement: reading, frequency, event status.
struct Asked {
    answers: [String; 3],
    at: RigTime,
}

/// Whether it makes sense to try again: the answer was lost or damaged, or the instrument was
/// switched off and on, but it did not refuse.
fn is_passing(error: &AnalyzerError) -> bool {
    match error {
        AnalyzerError::Line { source, .. } => {
            matches!(source, rig_link::LineError::TimedOut { .. })
        }
        AnalyzerError::Answer { .. } => true,
        AnalyzerError::Refused { status, .. } => status.is_power_on(),
        _ => false,
    }
}
