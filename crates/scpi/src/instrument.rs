//! An instrument on the wire: bytes in, calls out, answers in, bytes out.
//!
//! ```text
//!  push ──▶ splitter ──▶ message ──▶ unit ──▶ built in? ──yes──▶ done here
//!                           ▲                     │no
//!                           │                     ▼
//!  take_output ◀── answer ──┴──── answer() ◀── poll() gives a Call to the host
//! ```
//!
//! One call is under way at a time; while the host carries it out, [`Instrument::poll`] gives
//! nothing. Time is the host's: a command may take as long as it likes.

mod builtin;
pub(crate) mod dialect;
mod message;
pub(crate) mod pattern;
pub(crate) mod status;
pub(crate) mod tree;

use crate::{
    grammar::error::{ErrorClass, ErrorQueue, ScpiError},
    grammar::param::Param,
    grammar::parse::{self, Header},
    grammar::scan::Rules,
    grammar::splitter::{MessageSplitter, SplitMessage},
    grammar::value::Value,
    instrument::dialect::{AfterErrorPolicy, AfterQueryPolicy, Dialect, UnreadPolicy},
    instrument::status::Status,
    instrument::tree::{Arity, HeaderMatch, Tree},
};
use builtin::Builtin;
use message::Message;

/// A command that the host must carry out and then [answer](Instrument::answer).
#[derive(Debug, Clone, PartialEq)]
pub struct Call<C> {
    /// Name of the command in the tree.
    pub command: C,
    /// Whether it ended in `?`.
    pub is_query: bool,
    /// The numbers behind the mnemonics with `#`, in order; `None` where none was given.
    pub suffixes: Vec<Option<u32>>,
    /// The data, as many as the tree allows.
    pub params: Vec<Param>,
}

impl<C> Call<C> {
    /// The numeric suffix at `index`, which is 1 where none was given.
    pub fn suffix(&self, index: usize) -> u32 {
        self.suffixes.get(index).copied().flatten().unwrap_or(1)
    }

    /// The parameter at `index`.
    ///
    /// # Errors
    /// −109 when there are fewer.
    pub fn param(&self, index: usize) -> Result<&Param, ScpiError> {
        self.params.get(index).ok_or(ScpiError::new(-109))
    }
}

/// The state of an instrument between two bytes.
#[derive(Debug, Clone)]
pub struct Instrument<C> {
    commands: Tree<C>,
    dialect: Dialect,
    session: Box<Session>,
    status: Status,
    errors: Option<ErrorQueue>,
    has_headers: bool,
    is_operation_pending: bool,
    /// `*OPC` was sent and its operations are not complete.
    wants_operation_complete: bool,
}

/// The input and output of one client. Status, errors and settings belong to the instrument and are
/// the same for all clients.
#[derive(Debug, Clone)]
pub struct Session {
    splitter: MessageSplitter,
    message: Message,
    blocked_by: Option<BlockedBy>,
    output: Vec<u8>,
}

impl Session {
    /// A client that has said nothing yet.
    pub fn new(dialect: &Dialect) -> Self {
        Self {
            splitter: MessageSplitter::new(rules(dialect), dialect.input_limit_bytes),
            message: Message::default(),
            blocked_by: None,
            output: Vec::new(),
        }
    }
}

/// The part that carries out a unit.
#[derive(Debug, Clone, Copy)]
enum Target<C> {
    Host(C),
    Builtin(Builtin),
}

/// Why the next unit is not carried out yet.
#[derive(Debug, Clone, PartialEq, Eq)]
enum BlockedBy {
    /// The host carries out a call. `heading` goes before its answer.
    Call { heading: String },
    /// As above, but the message was discarded, and so is the answer.
    AbandonedCall,
    /// `*WAI`.
    Operations,
    /// `*OPC?`.
    OperationsThenAnswer,
}

impl<C: Copy> Instrument<C> {
    /// An instrument after power-on.
    ///
    /// Common commands and subsystems that the standards demand are built in; a node of `commands`
    /// with the same header takes precedence.
    pub fn new(commands: Tree<C>, dialect: Dialect) -> Self {
        let mut status = Status::default();
        status.raise(ErrorClass::PowerOn.event_bit());
        Self {
            commands,
            session: Box::new(Session::new(&dialect)),
            status,
            errors: dialect.error_queue.map(ErrorQueue::new),
            has_headers: dialect.headers.unwrap_or(false),
            is_operation_pending: false,
            wants_operation_complete: false,
            dialect,
        }
    }

    /// Turns to another client, and leaves the present one's session in `session`. An instrument
    /// with one client needs none of this.
    pub const fn turn_to(&mut self, session: &mut Box<Session>) {
        std::mem::swap(&mut self.session, session);
    }

    /// Takes bytes in, cut anywhere.
    pub fn push(&mut self, bytes: &[u8]) {
        self.session.splitter.push(bytes);
    }

    /// The transport says that a message ends here, with or without a terminator.
    pub fn end_of_message(&mut self) {
        self.session.splitter.end_of_message();
    }

    /// Number of bytes that [`Self::push`] takes without an overrun.
    pub fn room(&self) -> usize {
        self.session.splitter.room()
    }

    /// Carries out the built-in commands and returns the next call for the host.
    ///
    /// `None` when more bytes are needed, a call is under way, or `*WAI` or `*OPC?` waits for
    /// [operations](Self::set_operation_pending).
    pub fn poll(&mut self) -> Option<Call<C>> {
        loop {
            match &self.session.blocked_by {
                Some(BlockedBy::Call { .. } | BlockedBy::AbandonedCall) => return None,
                Some(_) if self.is_operation_pending => return None,
                Some(BlockedBy::OperationsThenAnswer) => self.respond("", &[Value::Integer(1)]),
                Some(BlockedBy::Operations) | None => {}
            }
            self.session.blocked_by = None;
            if !self.session.message.is_running && !self.begin_message() {
                return None;
            }
            if !self.session.message.has_units() {
                self.end_message();
                continue;
            }
            if let Some(call) = self.next_unit() {
                return Some(call);
            }
        }
    }

    /// Answers the call under way. A command answers with no values; a query, or a command of an
    /// instrument whose trigger answers, with some. An error is queued, and nothing is answered.
    ///
    /// # Panics
    /// When no call is under way: that is a mistake of the host.
    pub fn answer(&mut self, result: Result<Vec<Value>, ScpiError>) {
        match self.session.blocked_by.take() {
            Some(BlockedBy::Call { heading }) => match result {
                Ok(values) => self.respond(&heading, &values),
                Err(error) => self.fail(error),
            },
            Some(BlockedBy::AbandonedCall) => {}
            _ => panic!("no call is under way"),
        }
    }

    /// The answers to whole messages, each with its ending; empty when there are none.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.session.output)
    }

    /// The controller asks for an answer, on a bus where answers are fetched. Asking for one when
    /// there is none and none will come is −420.
    pub fn fetch_output(&mut self) -> Option<Vec<u8>> {
        if !self.session.output.is_empty() {
            return Some(self.take_output());
        }
        if !self.session.message.is_running {
            self.report_query_error(-420);
        }
        None
    }

    /// Whether operations of earlier commands are in progress, such as a sweep. `*OPC`, `*OPC?` and
    /// `*WAI` wait for their end.
    pub fn set_operation_pending(&mut self, is_pending: bool) {
        self.is_operation_pending = is_pending;
        if !is_pending && std::mem::take(&mut self.wants_operation_complete) {
            self.status.raise(ErrorClass::OperationComplete.event_bit());
        }
    }

    /// Queues an error that no message caused, such as a failed self-test.
    pub fn report(&mut self, error: ScpiError) {
        let class_bit = error.class().map_or(0, ErrorClass::event_bit);
        self.status.raise(class_bit);
        if let Some(errors) = &mut self.errors
            && !errors.push(error)
        {
            self.status.raise(ErrorClass::Device.event_bit());
        }
    }

    /// Device clear: discards input, output and the present message. Status, errors and settings
    /// stay. A call in progress must still be answered; its answer is discarded.
    pub fn device_clear(&mut self) {
        self.session.splitter.clear();
        self.session.message = Message::default();
        self.session.output.clear();
        self.wants_operation_complete = false;
        self.session.blocked_by = match self.session.blocked_by.take() {
            Some(BlockedBy::Call { .. } | BlockedBy::AbandonedCall) => {
                Some(BlockedBy::AbandonedCall)
            }
            _ => None,
        };
    }

    /// The status byte, as a serial poll or `*STB?` would show it.
    pub(crate) fn status_byte(&self) -> u8 {
        let has_errors = self.errors.as_ref().is_some_and(|errors| !errors.is_empty());
        // Without fetching of answers, a finished answer has been sent and is no longer available.
        let has_output =
            self.dialect.unread != UnreadPolicy::Keep && !self.session.output.is_empty();
        self.status.byte(has_errors, has_output || self.session.message.answer.has_data)
    }

    /// The status registers.
    pub const fn status(&self) -> &Status {
        &self.status
    }

    /// The registers, for the host to set conditions.
    pub const fn status_mut(&mut self) -> &mut Status {
        &mut self.status
    }

    /// The dialect of the instrument.
    pub const fn dialect(&self) -> &Dialect {
        &self.dialect
    }

    fn begin_message(&mut self) -> bool {
        loop {
            match self.session.splitter.next_message(&mut self.session.message.bytes) {
                None => return false,
                Some(SplitMessage::Overrun) => self.report(ScpiError::new(-363)),
                Some(SplitMessage::Message) => break,
            }
        }
        if !self.session.output.is_empty() && self.dialect.unread == UnreadPolicy::Drop {
            self.session.output.clear();
            self.report_query_error(-410);
        }
        self.session.message.begin();
        true
    }

    fn end_message(&mut self) {
        self.session.message.is_running = false;
        self.session.message.answer.finish(&mut self.session.output, self.dialect.ending);
    }

    /// Carries out one unit, or returns it as a call.
    fn next_unit(&mut self) -> Option<Call<C>> {
        let bytes = std::mem::take(&mut self.session.message.bytes);
        let unit = self.session.message.next_unit(&bytes, rules(&self.dialect));
        let call = self.run_unit(unit);
        self.session.message.bytes = bytes;
        call.unwrap_or_else(|error| {
            self.fail(error);
            None
        })
    }

    fn run_unit(&mut self, unit: &[u8]) -> Result<Option<Call<C>>, ScpiError> {
        let Some((header, data)) = parse::unit(unit)? else { return Ok(None) };
        self.refuse_after_query(&header)?;
        let path = self.session.message.absolute(&header);
        let Some((target, found)) = self.find(&path, &header) else {
            return Err(ScpiError::new(-113).with_info(header_text(&header)));
        };
        let heading = self.heading(&target, &found, &path, &header);
        self.session.message.enter(&header, path);
        let params = check(&found, data)?;
        if header.is_common && header.text.eq_ignore_ascii_case(b"RST") {
            self.wants_operation_complete = false;
        }
        match target {
            Target::Builtin(builtin) => {
                self.run_builtin(builtin, header.is_query, &params, &heading)?;
                Ok(None)
            }
            Target::Host(command) => {
                self.session.blocked_by = Some(BlockedBy::Call { heading });
                let (is_query, suffixes) = (header.is_query, found.suffixes);
                Ok(Some(Call { command, is_query, suffixes, params }))
            }
        }
    }

    /// Finds a header from the root. The host's commands take precedence over the built-in ones.
    fn find(&self, path: &[u8], header: &Header<'_>) -> Option<(Target<C>, HeaderMatch)> {
        if let Some((command, found)) = self.commands.find(path, header) {
            return Some((Target::Host(command), found));
        }
        let (builtin, found) = builtin::TREE.find(path, header)?;
        builtin::has(&self.dialect, builtin).then_some((Target::Builtin(builtin), found))
    }

    /// Beginning of the answer.
    fn heading(
        &self,
        target: &Target<C>,
        found: &HeaderMatch,
        path: &[u8],
        header: &Header<'_>,
    ) -> String {
        if !self.has_headers || !found.is_setting || header.is_common {
            return String::new();
        }
        match target {
            Target::Host(_) => self.commands.heading(found, path),
            Target::Builtin(_) => builtin::TREE.heading(found, path),
        }
    }

    /// Nothing can follow data that only the end of the message ends (IEEE 488.2, 6.5.7.5), and with
    /// some instruments nothing can follow a query.
    fn refuse_after_query(&mut self, header: &Header<'_>) -> Result<(), ScpiError> {
        if self.session.message.has_query && self.dialect.after_query == AfterQueryPolicy::Refuse {
            self.session.message.skip_rest();
            return Err(ScpiError::new(-400));
        }
        self.session.message.has_query |= header.is_query;
        let is_lost = header.is_query && self.session.message.answer.is_indefinite;
        if is_lost && self.dialect.query_errors.contains(&-440) {
            return Err(ScpiError::new(-440));
        }
        Ok(())
    }

    fn respond(&mut self, heading: &str, values: &[Value]) {
        if values.is_empty() {
            return;
        }
        self.session.message.answer.begin(heading);
        self.session.message.answer.values(values, self.dialect.real_format);
        self.limit_output();
    }

    /// Drops the answer when there is no room for it.
    fn limit_output(&mut self) {
        let answer = &mut self.session.message.answer;
        if self.dialect.output_limit_bytes < answer.bytes.len() + self.session.output.len() {
            answer.clear();
            self.report_query_error(-430);
        }
    }

    fn report_query_error(&mut self, number: i16) {
        if self.dialect.query_errors.contains(&number) {
            self.report(ScpiError::new(number));
        }
    }

    /// An error in the message that is carried out.
    fn fail(&mut self, error: ScpiError) {
        self.report(error);
        if self.dialect.after_error == AfterErrorPolicy::SkipMessage {
            self.session.message.skip_rest();
        }
    }
}

/// Checks the data of a header against the tree.
fn check(found: &HeaderMatch, data: &[u8]) -> Result<Vec<Param>, ScpiError> {
    if found.is_out_of_range {
        return Err(ScpiError::new(-114));
    }
    let params = parse::params(data)?;
    let Arity { min, max } = found.arity;
    if params.len() < min {
        return Err(ScpiError::new(-109));
    }
    if max < params.len() {
        return Err(ScpiError::new(-108));
    }
    Ok(params)
}

const fn rules(dialect: &Dialect) -> Rules {
    Rules { terminators: dialect.terminators, strings_span_lines: dialect.strings_span_lines }
}

/// The header of the query.
fn header_text(header: &Header<'_>) -> String {
    let before = match header {
        Header { is_common: true, .. } => "*",
        Header { is_absolute: true, .. } => ":",
        _ => "",
    };
    let text = String::from_utf8_lossy(header.text);
    let question = if header.is_query { "?" } else { "" };
    format!("{before}{text}{question}")
}
