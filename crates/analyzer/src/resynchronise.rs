//! Synchronises host and analyzer, at the start and after a lost answer.

use std::time::Duration;

use rig_files::instrument::{
    dialect::{CommandSet, PointCommands},
    template::{Quantity, Template},
};
use rig_link::LineError;
use rig_model::{DriveLevel, with_causes};
use rig_scpi::{ExpectedResponse, Response};

use crate::{Analyzer, AnalyzerError, Identity, message::Message, questions::Question, trace};

/// Number of new starts of a measurement after a lost answer.
const ATTEMPTS: u32 = 3;

/// Listening time after a lost answer.
const QUARANTINE: Duration = Duration::from_millis(500);

/// Relative tolerance of the reported level: the instrument prints three digits.
const LEVEL_TOLERANCE_REL: f64 = 0.005;

impl Analyzer {
    /// Repeats an operation from its beginning while its errors are transient.
    pub(crate) async fn retry<T>(
        &mut self,
        mut what: impl AsyncFnMut(&mut Self) -> Result<T, AnalyzerError>,
    ) -> Result<T, AnalyzerError> {
        let mut attempts = 0;
        loop {
            attempts += 1;
            match what(self).await {
                Ok(done) => return Ok(done),
                Err(error) if !is_transient(&error) => {
                    self.is_synchronised &= !is_of_the_line(&error);
                    let is_refusal = matches!(error, AnalyzerError::Refused { .. });
                    self.port.health().note(|health| {
                        health.refusals += u64::from(is_refusal);
                        health.faults += u64::from(!is_refusal);
                    });
                    return Err(error);
                }
                Err(error) => {
                    self.is_synchronised = false;
                    let is_unreadable = is_unreadable(&error);
                    let is_last = attempts == ATTEMPTS;
                    self.port.health().note(|health| {
                        health.corrupt += u64::from(is_unreadable);
                        health.retries += u64::from(!is_last);
                        health.faults += u64::from(is_last);
                    });
                    if is_last {
                        return Err(self.explain(error).await);
                    }
                    let cause = with_causes(&error);
                    tracing::warn!(%cause, attempts, "beginning again");
                }
            }
        }
    }

    /// Says why an answer stayed lost. An instrument that ignores the rest of a message after an
    /// error in it is silent too, so that it is asked whether that was so.
    async fn explain(&mut self, error: AnalyzerError) -> AnalyzerError {
        let AnalyzerError::Line { asked, unexpected_terminator, source, .. } = error else {
            return error;
        };
        if self.port.wait_for_silence(QUARANTINE).await.is_ok()
            && let Ok(status) = self.event_status().await
            && status.is_error()
        {
            return self.refused(asked, status).await;
        }
        let intruders = self.port.link().intruders();
        AnalyzerError::Line { asked, unexpected_terminator, intruders, source }
    }

    /// Synchronises with the instrument: silence, no old errors, the expected identity.
    pub(crate) async fn synchronise(&mut self) -> Result<Identity, AnalyzerError> {
        if let (true, Some(identity)) = (self.is_synchronised, &self.identity) {
            return Ok(identity.clone());
        }
        self.is_set_up = false;
        self.port.wait_for_silence(QUARANTINE).await?;
        let mut greeting = Message::new();
        if let Some(first) = &self.dialect.transport.greeting {
            greeting = greeting.plain(first);
        }
        let greeting = greeting.command("*CLS").query("*IDN");
        let response = self.ask_line(&greeting).await?;
        let Ok(found) = Identity::parse(&response) else {
            return Err(self.port.unexpected(&greeting, "an identity", response.bytes()));
        };
        if self.identity.as_ref() != Some(&found) {
            self.confirm_line(&Message::new().query("*IDN"), &response).await?;
        }
        let (port, expected) = (self.port.name(), self.dialect.models.as_str());
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
        self.is_synchronised = true;
        Ok(found)
    }

    async fn ask_line(&mut self, question: &Message) -> Result<Response, AnalyzerError> {
        let within = self.port.reply_within();
        Ok(self.port.ask(question, ExpectedResponse::Line, within).await?.response)
    }

    /// Asks again for what decides the whole session: a line has no checksum, and only a second answer
    /// shows a wrong bit.
    async fn confirm_line(
        &mut self,
        question: &Message,
        first: &Response,
    ) -> Result<(), AnalyzerError> {
        let second = self.ask_line(question).await?;
        if second.bytes() == first.bytes() {
            return Ok(());
        }
        Err(self.port.unexpected(question, "the same answer twice", second.bytes()))
    }

    /// Whether two questions in one message get two answers in one line.
    async fn try_chain(&mut self) -> Result<bool, AnalyzerError> {
        let two_queries = Message::new().query("*ESR").query("*ESR");
        let within = self.port.reply_within();
        // No answer is an answer here, and is not counted.
        match self.port.exchange(&two_queries, ExpectedResponse::Data, within).await {
            Ok(answer) if answer.response.bytes() == b"0;0" => return Ok(true),
            // An instrument that does not allow it gives one answer or none.
            Ok(_) | Err(AnalyzerError::Line { source: LineError::TimedOut { .. }, .. }) => {}
            Err(error) => return Err(error),
        }
        // In that case it was an error. Reading the status clears it.
        self.port.wait_for_silence(QUARANTINE).await?;
        self.event_status().await?;
        Ok(false)
    }

    async fn find_high_power(&mut self) -> Result<bool, AnalyzerError> {
        let Some(high_power) = &self.dialect.high_power else { return Ok(false) };
        let options = Message::new().query("*OPT");
        let answer = self.ask_line(&options).await?;
        self.confirm_line(&options, &answer).await?;
        let text = String::from_utf8_lossy(answer.bytes()).into_owned();
        Ok(text.split(',').any(|option| option.trim() == high_power.option))
    }

    /// Gives the instrument its settings, if it has lost them or never had them.
    pub(crate) async fn set_up(&mut self) -> Result<(), AnalyzerError> {
        self.synchronise().await?;
        let Some(level) = self.level else {
            return Err(AnalyzerError::NotConfigured { port: self.port.name() });
        };
        if self.is_set_up {
            return Ok(());
        }
        self.current = None;
        let high_power = self.dialect.high_power.as_ref().filter(|_| self.has_high_power);
        let switch = high_power.and_then(|high_power| high_power.switch.as_ref());
        let commands = &self.dialect.commands;
        let messages = match commands {
            CommandSet::Points(commands) => setup(commands, level, switch),
            CommandSet::TraceE4990a => trace::setup(level),
        };
        let level_of = |m: Message| match commands {
            CommandSet::Points(commands) => m.plain(&commands.level),
            CommandSet::TraceE4990a => m.query(trace::LEVEL),
        };
        for message in messages {
            self.confirm(message).await?;
        }
        let questions: [Question<'_>; 2] = [&level_of, &|m| m.query("*ESR")];
        let ([volt, status], _, asked) = self.ask_all(&questions, self.port.reply_within()).await?;
        let status = self.read_status(&asked, status.first())?;
        self.check(&asked, status).await?;
        let found = self.number(&level_of(Message::new()), &volt)?;
        if (found - level.volt).abs() > LEVEL_TOLERANCE_REL * level.volt {
            let (port, wanted) = (self.port.name(), level.volt);
            return Err(AnalyzerError::NotTaken { port, what: "level in V", wanted, found });
        }
        self.is_set_up = true;
        Ok(())
    }
}

/// The settings of a measurement at a level. `switch` is the command for a high level, if it needs one.
fn setup(commands: &PointCommands, level: DriveLevel, switch: Option<&Template>) -> Vec<Message> {
    let value = |_: Quantity| level.volt;
    let message = |template: &Template| {
        let first = switch.filter(|_| template.holds(Quantity::Level));
        first
            .map_or_else(Message::new, |switch| Message::new().plain(switch))
            .template(template, value)
    };
    commands.setup.iter().map(message).collect()
}

/// Whether another attempt can succeed: after a lost or damaged answer or a restart of the
/// instrument, but not after a refusal.
const fn is_transient(error: &AnalyzerError) -> bool {
    match error {
        AnalyzerError::Line { source, .. } => matches!(source, LineError::TimedOut { .. }),
        AnalyzerError::Answer { .. }
        | AnalyzerError::Strays { .. }
        | AnalyzerError::Frame { .. }
        | AnalyzerError::HeldUp { .. }
        | AnalyzerError::Restarted { .. } => true,
        _ => false,
    }
}

/// Whether an answer came that could not be read, or answered something else.
const fn is_unreadable(error: &AnalyzerError) -> bool {
    matches!(
        error,
        AnalyzerError::Answer { .. } | AnalyzerError::Strays { .. } | AnalyzerError::Frame { .. }
    )
}

/// Whether the next answer can no longer be assigned to a question.
const fn is_of_the_line(error: &AnalyzerError) -> bool {
    matches!(
        error,
        AnalyzerError::Line { .. } | AnalyzerError::Unquiet { .. } | AnalyzerError::Reopen { .. }
    )
}
