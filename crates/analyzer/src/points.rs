//! Measures one frequency after the other.

use std::time::Duration;

use rig_files::instrument::{
    dialect::{PointCommands, Poll},
    template::Quantity,
};
use rig_link::StopSignal;
use rig_model::{PointResult, Reading, RigTime, SweepPoint};
use rig_scpi::Datum;
use tokio::time::{Instant, sleep, sleep_until};

use crate::{
    Analyzer, AnalyzerError, answer,
    message::Message,
    point::{Integration, TriggerSettings, mean},
    questions::shown,
};

/// During the search for the range, integration may take this multiple of the requested cycles.
const MEASURE_TIMES: f64 = 3.0;

/// Interval between queries for a measurement that is not ready.
const POLL: Duration = Duration::from_millis(20);

impl Analyzer {
    /// Measures one point; no reading when a stop was raised.
    pub(crate) async fn try_point(
        &mut self,
        commands: &PointCommands,
        point: &SweepPoint,
        stop: &StopSignal,
    ) -> Result<Vec<Reading>, AnalyzerError> {
        self.set_up().await?;
        let frequency_hz = self.dialect.resolution.round(point.frequency_hz);
        let integration = Integration::by_rule(point.cycles, frequency_hz, &commands.integration);
        let delay_s = point.settle_s.min(self.dialect.delay_max_s);
        let mut wanted = TriggerSettings { frequency_hz, averages: integration.averages, delay_s };
        let rest_s = point.settle_s - delay_s;
        if 0.0 < rest_s && !self.settle(commands, &wanted, rest_s, stop).await? {
            return Ok(Vec::new());
        }
        let trigger_s = integration.cycles_per_trigger() / frequency_hz;
        let mut measured = Vec::new();
        let mut first = None;
        for _ in 0..integration.triggers {
            if stop.is_raised() {
                return Ok(Vec::new());
            }
            let (one, found_hz, asked_at) = self.trigger_once(commands, &wanted, trigger_s).await?;
            measured.push(one);
            first.get_or_insert((found_hz, asked_at));
            // The next trigger needs no settling.
            wanted.delay_s = 0.0;
        }
        let Some((found_hz, asked_at)) = first else { return Ok(Vec::new()) };
        let waited_s = asked_at.since(self.frequency_set_at).as_secs_f64();
        Ok(vec![Reading {
            frequency_hz: found_hz,
            measured: mean(&measured),
            started: self.frequency_set_at,
            settle_s: waited_s + delay_s,
            integration_s: f64::from(integration.triggers) * trigger_s,
        }])
    }

    /// Sets a shot and waits, for longer than the instrument itself can. `false` after a requested
    /// stop.
    async fn settle(
        &mut self,
        commands: &PointCommands,
        wanted: &TriggerSettings,
        seconds: f64,
        stop: &StopSignal,
    ) -> Result<bool, AnalyzerError> {
        let before = self.current.take();
        let message = settings(Message::new(), commands, wanted, before.as_ref());
        self.confirm(message).await?;
        if before.is_none_or(|before| before.frequency_hz != wanted.frequency_hz) {
            self.frequency_set_at = self.port.link().clock().now();
        }
        self.current = Some(*wanted);
        tokio::select! {
            biased;
            () = stop.raised() => Ok(false),
            () = sleep(Duration::from_secs_f64(seconds)) => Ok(true),
        }
    }

    /// Sends the changed settings, triggers once, and confirms frequency and status.
    async fn trigger_once(
        &mut self,
        commands: &PointCommands,
        wanted: &TriggerSettings,
        trigger_s: f64,
    ) -> Result<(PointResult, f64, RigTime), AnalyzerError> {
        // Until it has confirmed, nothing is known about its settings.
        let before = self.current.take();
        let within = self.port.reply_within()
            + Duration::from_secs_f64(wanted.delay_s + MEASURE_TIMES * trigger_s);
        let begun = Instant::now();
        let trigger = |m| settings(m, commands, wanted, before.as_ref()).plain(&commands.trigger);
        let mut triggered_at = None;
        if let Some(poll) = &commands.poll {
            let ([status], at, message) =
                self.ask_all(&[&|m| trigger(m).query("*ESR")], self.port.reply_within()).await?;
            let status = self.read_status(&message, status.first())?;
            self.check(&message, status).await?;
            let ready_at = begun + Duration::from_secs_f64(wanted.delay_s + trigger_s);
            self.poll_until(poll, ready_at, begun + within).await?;
            triggered_at = Some(at);
        }
        let read = |m| if commands.poll.is_some() { m } else { trigger(m) }.plain(&commands.read);
        let frequency_of = |m: Message| m.plain(&commands.frequency);
        let ([reading, frequency, status], asked_at, message) =
            self.ask_all(&[&read, &frequency_of, &|m| m.query("*ESR")], within).await?;
        let asked_at = triggered_at.unwrap_or(asked_at);
        let status = self.read_status(&message, status.first())?;
        self.check(&message, status).await?;
        let found_hz = self.number(&frequency_of(Message::new()), &frequency)?;
        let tolerance_hz = self.dialect.resolution.tolerance_hz(wanted.frequency_hz);
        if (found_hz - wanted.frequency_hz).abs() > tolerance_hz {
            let (port, wanted) = (self.port.name(), wanted.frequency_hz);
            let what = "frequency in Hz";
            return Err(AnalyzerError::NotTaken { port, what, wanted, found: found_hz });
        }
        let measured = match answer::reading(&reading, &commands.answer) {
            Ok(Some(measured)) => measured,
            Ok(None) => {
                // Earlier it cannot be ready, and each question takes time on a line with echoes.
                sleep_until(begun + Duration::from_secs_f64(wanted.delay_s + trigger_s)).await;
                self.fetch_until(commands, begun + within).await?
            }
            Err(_) => return Err(self.not_a_reading(&message, &reading)),
        };
        if before.is_none_or(|before| before.frequency_hz != wanted.frequency_hz) {
            self.frequency_set_at = asked_at;
        }
        self.current = Some(*wanted);
        Ok((measured, found_hz, asked_at))
    }

    /// Asks again for a measurement that was not ready.
    async fn fetch_until(
        &mut self,
        commands: &PointCommands,
        deadline: Instant,
    ) -> Result<PointResult, AnalyzerError> {
        loop {
            sleep(POLL).await;
            let ([reading], _, message) =
                self.ask_all(&[&|m| m.plain(&commands.read)], self.port.reply_within()).await?;
            match answer::reading(&reading, &commands.answer) {
                Ok(Some(measured)) => return Ok(measured),
                Ok(None) if Instant::now() < deadline => {}
                _ => return Err(self.not_a_reading(&message, &reading)),
            }
        }
    }

    /// Asks until the measurement is over, first when it can be.
    async fn poll_until(
        &mut self,
        poll: &Poll,
        ready_at: Instant,
        deadline: Instant,
    ) -> Result<(), AnalyzerError> {
        let deadline = deadline.max(ready_at) + Duration::from_secs_f64(poll.timeout_s);
        sleep_until(ready_at).await;
        loop {
            let ([status], _, message) =
                self.ask_all(&[&|m| m.plain(&poll.ask)], self.port.reply_within()).await?;
            let word = status.first().and_then(|datum| datum.integer().ok());
            let is_over = word.is_some_and(|word| word & i64::from(poll.mask) != 0);
            if is_over {
                return Ok(());
            }
            if word.is_none() || deadline <= Instant::now() {
                let found = shown(&status);
                let expected = "a status with the bit of a measurement that is over";
                return Err(self.port.unexpected(&message, expected, found.as_bytes()));
            }
            sleep(POLL).await;
        }
    }

    fn not_a_reading(&self, asked: &Message, data: &[Datum]) -> AnalyzerError {
        let found = shown(data);
        let expected = "resistance and reactance in ohm, and a status";
        self.port.unexpected(asked, expected, found.as_bytes())
    }
}

/// Adds the settings of a shot that differ from those before it.
fn settings(
    mut message: Message,
    commands: &PointCommands,
    wanted: &TriggerSettings,
    before: Option<&TriggerSettings>,
) -> Message {
    let value = |quantity| match quantity {
        Quantity::Frequency => wanted.frequency_hz,
        Quantity::Averages => wanted.averages.into(),
        Quantity::Delay => wanted.delay_s,
        Quantity::Level | Quantity::Cable => f64::NAN,
    };
    if before.is_none_or(|before| before.frequency_hz != wanted.frequency_hz) {
        message = message.template(&commands.set_frequency, value);
    }
    if before.is_none_or(|before| before.averages != wanted.averages) {
        message = message.template(&commands.set_averages, value);
    }
    if before.is_none_or(|before| before.delay_s != wanted.delay_s) {
        message = message.template(&commands.set_delay, value);
    }
    message
}
