//! An analyzer: identified, configured, and then asked for readings.

use std::time::Duration;

use rig_link::{LineError, Port, StopSignal, Transcript};
use rig_model::{DriveLevel, Reading, RigTime, SweepPoint};
use rig_scpi::{Datum, ErrorReport, Expect};

use crate::{
    AnalyzerError, Dialect, EventStatus, Identity,
    dialect::{CommandSet, PointCommands},
    hioki, lcr,
    message::Message,
    point::Shot,
    trace,
    wire::{ANSWER_WITHIN, Answered, Wire},
};

/// How often a measurement is begun anew after its answer was lost.
const ATTEMPTS: u32 = 3;

/// How long the line is only listened to after a lost answer.
const QUARANTINE: Duration = Duration::from_millis(500);

/// The longest settling that is waited for, s.
const SETTLE_MAX_S: f64 = 60.0;

/// The most cycles that are integrated at a point.
const CYCLES_MAX: u32 = 100_000;

/// How far the level that the instrument reports may be from the one asked for: it prints three
/// digits.
const LEVEL_TOLERANCE_REL: f64 = 0.005;

/// More errors than this are not read out of an error queue.
const REPORTS_MAX: usize = 20;

/// An impedance analyzer and its port.
///
/// ```text
///          ┌────────────────── lost or strange answer ──────────────────┐
///          ▼                                                            │
///   out of step ── silence, no errors, same identity ──▶ in step ── level ──▶ set up
/// ```
#[derive(Debug)]
pub struct Analyzer {
    pub(crate) wire: Wire,
    pub(crate) dialect: &'static Dialect,
    identity: Option<Identity>,
    /// Whether several questions may stand in one message; found out at the first greeting.
    can_chain: Option<bool>,
    /// Whether it has the option that drives more.
    has_high_power: bool,
    /// Whether the next answer is known to belong to the next question.
    is_in_step: bool,
    /// The level to measure at, and whether the instrument has it.
    level: Option<DriveLevel>,
    is_set_up: bool,
    /// What the instrument is set to, as far as it has confirmed.
    pub(crate) current: Option<Shot>,
    /// When its frequency was last set.
    pub(crate) frequency_set_at: RigTime,
}

/// Adds one or more units to a message; of these, one is a question.
pub(crate) type Question<'a> = &'a (dyn Fn(Message) -> Message + Sync);

impl Analyzer {
    /// An analyzer of this dialect at this port. Nothing is sent yet.
    pub fn open(port: Port, dialect: &'static Dialect) -> Self {
        Self {
            wire: Wire::new(port, dialect.quirks),
            dialect,
            identity: None,
            can_chain: None,
            has_high_power: false,
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

    /// Prepares measurements at this level. Does nothing when they are prepared.
    ///
    /// # Errors
    /// [`AnalyzerError::OutOfRange`] for a level that the instrument cannot give; it was not sent
    /// then. [`AnalyzerError::Refused`], [`AnalyzerError::NotTaken`].
    pub async fn configure(&mut self, level: DriveLevel) -> Result<(), AnalyzerError> {
        if self.is_in_step && self.is_set_up && self.level == Some(level) {
            return Ok(());
        }
        // Which options it has is known once it is identified.
        self.persist(async |this| this.get_in_step().await).await?;
        let (min, max) = self.dialect.level_v;
        let high_power = self.dialect.high_power.filter(|_| self.has_high_power);
        let max = high_power.map_or(max, |high_power| high_power.max_v);
        self.within("level in V", level.volt, (min, max))?;
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
        let commands = self.dialect.commands;
        let (settle_max_s, cycles_max) = match commands {
            CommandSet::Points(_) => (SETTLE_MAX_S, CYCLES_MAX),
            CommandSet::Trace => (trace::DELAY_MAX_S, trace::AVERAGES_MAX),
        };
        for point in points {
            self.within("frequency in Hz", point.frequency_hz, self.dialect.frequency_hz)?;
            self.within("settling in s", point.settle_s, (0.0, settle_max_s))?;
            self.within("cycles", point.cycles.into(), (1.0, cycles_max.into()))?;
        }
        let mut readings = Vec::with_capacity(points.len());
        while readings.len() < points.len() {
            let rest = &points[readings.len()..];
            let more = match commands {
                _ if stop.is_raised() => Vec::new(),
                CommandSet::Trace => self.persist(async |this| this.try_trace(rest).await).await?,
                CommandSet::Points(commands) => {
                    let first = &rest[0];
                    self.persist(async |this| this.try_point(commands, first, stop).await).await?
                }
            };
            if more.is_empty() {
                let (done, points) = (readings.len(), points.len());
                return Err(AnalyzerError::Stopped { done, points });
            }
            readings.extend(more);
        }
        Ok(readings)
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
                Err(error) if !is_passing(&error) => {
                    self.is_in_step &= !is_of_the_line(&error);
                    return Err(error);
                }
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

    /// Says why an answer stayed lost. An instrument that ignores the rest of a message after an
    /// error in it is silent too, so that it is asked whether that was so.
    async fn explain(&mut self, error: AnalyzerError) -> AnalyzerError {
        let AnalyzerError::Line { asked, source, .. } = error else { return error };
        if self.wire.put_in_order(QUARANTINE).await.is_ok()
            && let Ok(status) = self.event_status().await
            && status.is_error()
        {
            return self.refused(asked, status).await;
        }
        AnalyzerError::Line { asked, intruders: self.wire.port().intruders(), source }
    }

    /// Finds a common footing: silence, no old errors, the instrument that is expected.
    async fn get_in_step(&mut self) -> Result<Identity, AnalyzerError> {
        if let (true, Some(identity)) = (self.is_in_step, &self.identity) {
            return Ok(identity.clone());
        }
        self.is_set_up = false;
        self.wire.put_in_order(QUARANTINE).await?;
        let mut greeting = Message::new();
        if self.dialect.quirks.has_headers {
            greeting = greeting.choose(":HEADer", "OFF");
        }
        let greeting = greeting.command("*CLS").query("*IDN");
        let Answered { response, .. } =
            self.wire.ask(&greeting, Expect::Line, ANSWER_WITHIN).await?;
        let Ok(found) = rig_scpi::Identity::parse(&response).map(Identity::from) else {
            return Err(self.wire.unexpected(&greeting, "an identity", response.bytes()));
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
            self.has_high_power = self.find_high_power().await?;
        }
        self.identity = Some(found.clone());
        self.is_in_step = true;
        Ok(found)
    }

    /// Whether two questions in one message get two answers in one line.
    async fn try_chain(&mut self) -> Result<bool, AnalyzerError> {
        let twice = Message::new().query("*ESR").query("*ESR");
        match self.wire.ask(&twice, Expect::Data, ANSWER_WITHIN).await {
            Ok(answered) if answered.response.bytes() == b"0;0" => return Ok(true),
            // One answer or none is what comes where it is not allowed.
            Ok(_) | Err(AnalyzerError::Line { source: LineError::TimedOut { .. }, .. }) => {}
            Err(error) => return Err(error),
        }
        // Where it is not allowed, it was an error. It is read, and forgotten with that.
        self.wire.put_in_order(QUARANTINE).await?;
        self.event_status().await?;
        Ok(false)
    }

    async fn find_high_power(&mut self) -> Result<bool, AnalyzerError> {
        let Some(high_power) = self.dialect.high_power else { return Ok(false) };
        let options = Message::new().query("*OPT");
        let answered = self.wire.ask(&options, Expect::Line, ANSWER_WITHIN).await?;
        let text = String::from_utf8_lossy(answered.response.bytes()).into_owned();
        Ok(text.split(',').any(|option| option.trim() == high_power.option))
    }

    /// Gives the instrument its settings, if it has lost them or never had them.
    pub(crate) async fn get_set_up(&mut self) -> Result<(), AnalyzerError> {
        self.get_in_step().await?;
        let Some(level) = self.level else {
            return Err(AnalyzerError::NotConfigured { port: self.wire.name() });
        };
        if self.is_set_up {
            return Ok(());
        }
        self.current = None;
        let high_power = self.dialect.high_power.filter(|_| self.has_high_power);
        let (messages, level_header) = match self.dialect.commands {
            CommandSet::Points(PointCommands::Hioki) => (hioki::setup(level), hioki::LEVEL),
            CommandSet::Points(PointCommands::Lcr(variant)) => {
                (lcr::setup(level, variant, high_power), lcr::LEVEL)
            }
            CommandSet::Trace => (trace::setup(level), trace::LEVEL),
        };
        for message in messages {
            self.confirm(message).await?;
        }
        let questions: [Question<'_>; 2] = [&|m| m.query(level_header), &|m| m.query("*ESR")];
        let (answers, _, asked) = self.ask_all(&questions, ANSWER_WITHIN).await?;
        let status = self.read_status(&asked, answers[1].first())?;
        self.check(&asked, status).await?;
        let found = self.number(level_header, &answers[0])?;
        if (found - level.volt).abs() > LEVEL_TOLERANCE_REL * level.volt {
            let (port, wanted) = (self.wire.name(), level.volt);
            return Err(AnalyzerError::NotTaken { port, what: "level in V", wanted, found });
        }
        self.is_set_up = true;
        Ok(())
    }

    /// Sends a message and asks for the event status behind it. The question tells a message that
    /// was lost from one that was heard.
    pub(crate) async fn confirm(&mut self, message: Message) -> Result<(), AnalyzerError> {
        let message = message.query("*ESR");
        let answered = self.wire.ask(&message, Expect::Data, ANSWER_WITHIN).await?;
        let status = self.read_status(&message, answered.response.datum().ok().as_ref())?;
        self.check(&message, status).await
    }

    /// Asks several questions, in one message where the instrument can take that. Returns the data
    /// of each answer, and when the first question had left the host.
    pub(crate) async fn ask_all(
        &mut self,
        questions: &[Question<'_>],
        first_within: Duration,
    ) -> Result<(Vec<Vec<Datum>>, RigTime, Message), AnalyzerError> {
        let all = questions.iter().fold(Message::new(), |message, ask| ask(message));
        if self.can_chain == Some(true) {
            let Answered { response, asked_at } =
                self.wire.ask(&all, Expect::Data, first_within).await?;
            let answers: Vec<Vec<Datum>> = match response.units() {
                Ok(units) => units.into_iter().map(|unit| unit.data).collect(),
                Err(_) => Vec::new(),
            };
            if answers.len() != questions.len() {
                let expected = "an answer to each question";
                return Err(self.wire.unexpected(&all, expected, response.bytes()));
            }
            return Ok((answers, asked_at, all));
        }
        let mut answers = Vec::with_capacity(questions.len());
        let mut first_asked_at = None;
        for ask in questions {
            let message = ask(Message::new());
            let within = if answers.is_empty() { first_within } else { ANSWER_WITHIN };
            let Answered { response, asked_at } =
                self.wire.ask(&message, Expect::Data, within).await?;
            first_asked_at.get_or_insert(asked_at);
            let Ok(data) = response.data() else {
                return Err(self.wire.unexpected(&message, "one answer", response.bytes()));
            };
            answers.push(data);
        }
        Ok((answers, first_asked_at.unwrap_or_default(), all))
    }

    async fn event_status(&mut self) -> Result<EventStatus, AnalyzerError> {
        let message = Message::new().query("*ESR");
        let answered = self.wire.ask(&message, Expect::Data, ANSWER_WITHIN).await?;
        self.read_status(&message, answered.response.datum().ok().as_ref())
    }

    pub(crate) fn read_status(
        &self,
        asked: &Message,
        datum: Option<&Datum>,
    ) -> Result<EventStatus, AnalyzerError> {
        let status = datum.and_then(|datum| u8::try_from(datum.integer().ok()?).ok());
        status.map(EventStatus).ok_or_else(|| {
            let found = format!("{datum:?}");
            self.wire.unexpected(asked, "an event status", found.as_bytes())
        })
    }

    /// Makes an error of what the instrument reports.
    pub(crate) async fn check(
        &mut self,
        asked: &Message,
        status: EventStatus,
    ) -> Result<(), AnalyzerError> {
        if status.is_power_on() {
            return Err(AnalyzerError::Restarted { port: self.wire.name() });
        }
        if status.is_error() {
            return Err(self.refused(asked.to_string().into(), status).await);
        }
        Ok(())
    }

    async fn refused(&mut self, asked: Box<str>, status: EventStatus) -> AnalyzerError {
        let mut reports = Vec::new();
        let question = Message::new().query(":SYSTem:ERRor");
        while self.dialect.quirks.has_error_queue && reports.len() < REPORTS_MAX {
            let answered = self.wire.ask(&question, Expect::Data, ANSWER_WITHIN).await;
            match answered.map(|answered| ErrorReport::parse(&answered.response)) {
                Ok(Ok(Some(report))) => reports.push(report),
                _ => break,
            }
        }
        AnalyzerError::Refused { port: self.wire.name(), asked, status, reports }
    }

    pub(crate) fn number(&self, asked: &str, data: &[Datum]) -> Result<f64, AnalyzerError> {
        match data {
            [datum] if datum.number().is_ok() => Ok(datum.number().unwrap_or(f64::NAN)),
            _ => {
                let found = format!("{data:?}");
                let asked = Message::new().query(asked);
                Err(self.wire.unexpected(&asked, "a number", found.as_bytes()))
            }
        }
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

/// Whether it makes sense to try again: the answer was lost or damaged, or the instrument was
/// switched off and on, but it did not refuse.
const fn is_passing(error: &AnalyzerError) -> bool {
    match error {
        AnalyzerError::Line { source, .. } => matches!(source, LineError::TimedOut { .. }),
        AnalyzerError::Answer { .. }
        | AnalyzerError::Strays { .. }
        | AnalyzerError::Frame { .. }
        | AnalyzerError::Restarted { .. } => true,
        _ => false,
    }
}

/// Whether it is not known any more to what the next answer belongs.
const fn is_of_the_line(error: &AnalyzerError) -> bool {
    matches!(
        error,
        AnalyzerError::Line { .. } | AnalyzerError::Unquiet { .. } | AnalyzerError::Reopen { .. }
    )
}
