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

use crate::{
    dialect::{AfterError, AfterQuery, Dialect, Unread},
    error::{ErrorClass, ErrorQueue, ScpiError},
    grammar::{self, Header},
    param::Param,
    scan::{Rules, Scanner},
    splitter::{Arrival, MessageSplitter},
    status::Status,
    tree::{Arity, Found, Tree},
    value::Value,
};
use builtin::Builtin;

/// A command that the host must carry out and then [answer](Instrument::answer).
#[derive(Debug, Clone, PartialEq)]
pub struct Call<C> {
    /// What the tree calls it.
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
    builtins: Tree<Builtin>,
    dialect: Dialect,
    splitter: MessageSplitter,
    message: Message,
    waiting: Option<Waiting>,
    output: Vec<u8>,
    status: Status,
    errors: Option<ErrorQueue>,
    has_headers: bool,
    is_operation_pending: bool,
    /// `*OPC` was sent and its operations are not complete.
    wants_operation_complete: bool,
}

/// The message that is carried out.
#[derive(Debug, Clone, Default)]
struct Message {
    is_running: bool,
    bytes: Vec<u8>,
    /// Where the next unit begins.
    position: usize,
    /// The mnemonics that a relative header is appended to.
    path: Vec<u8>,
    /// A query was among its units.
    has_query: bool,
    answer: Answer,
}

/// The answers to the units so far.
#[derive(Debug, Clone, Default)]
struct Answer {
    bytes: Vec<u8>,
    /// There is an answer, though it may have no bytes.
    has_data: bool,
    /// It ends with data that only the end of the message ends.
    is_indefinite: bool,
}

/// Why the next unit is not carried out yet.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Waiting {
    /// The host carries out a call. `heading` goes before its answer.
    Call { heading: String },
    /// As above, but the message is gone, and the answer will go nowhere.
    AbandonedCall,
    /// `*WAI`.
    Operations,
    /// `*OPC?`.
    OperationsThenAnswer { heading: String },
}

impl<C: Copy> Instrument<C> {
    /// An instrument whose power just came on.
    ///
    /// Common commands and subsystems that the standards demand are built in; a node of `commands`
    /// with the same header takes precedence.
    pub fn new(commands: Tree<C>, dialect: Dialect) -> Self {
        let mut status = Status::default();
        status.raise(ErrorClass::PowerOn.event_bit());
        Self {
            commands,
            builtins: builtin::tree(&dialect),
            splitter: MessageSplitter::with_rules(rules(&dialect), dialect.input_limit_bytes),
            message: Message::default(),
            waiting: None,
            output: Vec::new(),
            status,
            errors: dialect.error_queue.map(ErrorQueue::new),
            has_headers: dialect.headers.unwrap_or(false),
            is_operation_pending: false,
            wants_operation_complete: false,
            dialect,
        }
    }

    /// Takes bytes in, cut anywhere.
    pub fn push(&mut self, bytes: &[u8]) {
        self.splitter.push(bytes);
    }

    /// The transport says that a message ends here, with or without a terminator.
    pub fn end_of_message(&mut self) {
        self.splitter.end_of_message();
    }

    /// How many bytes [`Self::push`] takes without an overrun.
    pub fn room(&self) -> usize {
        self.splitter.room()
    }

    /// Carries out what is built in and returns the next call for the host.
    ///
    /// `None` when more bytes are needed, a call is under way, or `*WAI` or `*OPC?` waits for
    /// [operations](Self::set_operation_pending).
    pub fn poll(&mut self) -> Option<Call<C>> {
        loop {
            match &self.waiting {
                Some(Waiting::Call { .. } | Waiting::AbandonedCall) => return None,
                Some(_) if self.is_operation_pending => return None,
                Some(Waiting::OperationsThenAnswer { heading }) => {
                    let heading = heading.clone();
                    self.respond(&heading, &[Value::Integer(1)]);
                }
                Some(Waiting::Operations) | None => {}
            }
            self.waiting = None;
            if !self.message.is_running && !self.begin_message() {
                return None;
            }
            if self.message.position > self.message.bytes.len() {
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
        match self.waiting.take() {
            Some(Waiting::Call { heading }) => match result {
                Ok(values) => self.respond(&heading, &values),
                Err(error) => self.fail(error),
            },
            Some(Waiting::AbandonedCall) => {}
            _ => panic!("no call is under way"),
        }
    }

    /// The answers to whole messages, each with its ending; empty when there are none.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.output)
    }

    /// The controller asks for an answer, on a bus where answers are fetched. Asking for one when
    /// there is none and none will come is −420.
    pub fn fetch_output(&mut self) -> Option<Vec<u8>> {
        if !self.output.is_empty() {
            return Some(self.take_output());
        }
        if !self.message.is_running {
            self.report_query_error(-420);
        }
        None
    }

    /// Whether operations go on that a command began, such as a sweep. `*OPC`, `*OPC?` and `*WAI`
    /// wait for their end.
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

    /// Device clear: input, output and the message under way are gone. Status, errors and settings
    /// stay. A call under way must still be answered; its answer goes nowhere.
    pub fn device_clear(&mut self) {
        self.splitter.clear();
        self.message = Message::default();
        self.output.clear();
        self.wants_operation_complete = false;
        self.waiting = match self.waiting.take() {
            Some(Waiting::Call { .. } | Waiting::AbandonedCall) => Some(Waiting::AbandonedCall),
            _ => None,
        };
    }

    /// The status byte, as a serial poll or `*STB?` would show it.
    pub fn status_byte(&self) -> u8 {
        let has_errors = self.errors.as_ref().is_some_and(|errors| !errors.is_empty());
        // Where answers are not fetched, a finished one is on its way and no longer available.
        let has_output = self.dialect.unread != Unread::Keep && !self.output.is_empty();
        self.status.byte(has_errors, has_output || self.message.answer.has_data)
    }

    /// The registers.
    pub const fn status(&self) -> &Status {
        &self.status
    }

    /// The registers, for the host to set conditions.
    pub const fn status_mut(&mut self) -> &mut Status {
        &mut self.status
    }

    /// The dialect.
    pub const fn dialect(&self) -> &Dialect {
        &self.dialect
    }

    fn begin_message(&mut self) -> bool {
        loop {
            match self.splitter.next_message(&mut self.message.bytes) {
                None => return false,
                Some(Arrival::Overrun) => self.report(ScpiError::new(-363)),
                Some(Arrival::Message) => break,
            }
        }
        if !self.output.is_empty() && self.dialect.unread == Unread::Drop {
            self.output.clear();
            self.report_query_error(-410);
        }
        self.message.path.clear();
        self.message.position = 0;
        self.message.has_query = false;
        self.message.is_running = true;
        true
    }

    fn end_message(&mut self) {
        self.message.is_running = false;
        let answer = &mut self.message.answer;
        answer.is_indefinite = false;
        if std::mem::take(&mut answer.has_data) {
            self.output.append(&mut answer.bytes);
            self.output.extend_from_slice(self.dialect.ending.bytes());
        }
    }

    /// Carries out one unit, or returns it as a call.
    fn next_unit(&mut self) -> Option<Call<C>> {
        let bytes = std::mem::take(&mut self.message.bytes);
        let unit = &bytes[self.message.position..];
        let n_bytes = match Scanner::new(rules(&self.dialect)).scan(unit) {
            Some((n_bytes, _)) => n_bytes - 1,
            None => unit.len(),
        };
        self.message.position += n_bytes + 1;
        let call = self.run_unit(&unit[..n_bytes]);
        self.message.bytes = bytes;
        call.unwrap_or_else(|error| {
            self.fail(error);
            None
        })
    }

    fn run_unit(&mut self, unit: &[u8]) -> Result<Option<Call<C>>, ScpiError> {
        let Some((header, data)) = grammar::unit(unit)? else { return Ok(None) };
        if self.message.has_query && self.dialect.after_query == AfterQuery::Refuse {
            self.message.skip_rest();
            return Err(ScpiError::new(-400));
        }
        self.message.has_query |= header.is_query;
        let path = self.message.absolute(&header);
        let undefined = || ScpiError::new(-113).with_info(header_text(&header));
        if let Some(found) = self.commands.find(&path, &header) {
            let heading = self.heading(&found, &header, &path);
            let command = found.id;
            let (suffixes, params) = check(found, data)?;
            self.message.enter(&header, path);
            self.refuse_after_indefinite(&header)?;
            self.cancel_on_reset(&header);
            self.waiting = Some(Waiting::Call { heading });
            return Ok(Some(Call { command, is_query: header.is_query, suffixes, params }));
        }
        let found = self.builtins.find(&path, &header).ok_or_else(undefined)?;
        let heading = self.heading(&found, &header, &path);
        let builtin = found.id;
        let (_, params) = check(found, data)?;
        self.message.enter(&header, path);
        self.refuse_after_indefinite(&header)?;
        self.cancel_on_reset(&header);
        self.run_builtin(builtin, header.is_query, &params, heading)?;
        Ok(None)
    }

    /// What goes before the data of an answer.
    fn heading<T>(&self, found: &Found<'_, T>, header: &Header<'_>, path: &[u8]) -> String {
        if self.has_headers && found.is_setting && !header.is_common {
            let mut heading = found.pattern.canonical(path);
            heading.push(' ');
            heading
        } else {
            String::new()
        }
    }

    /// IEEE 488.2, 6.5.7.5: nothing can follow data that only the end of the message ends.
    fn refuse_after_indefinite(&self, header: &Header<'_>) -> Result<(), ScpiError> {
        let is_refused = header.is_query
            && self.message.answer.is_indefinite
            && self.dialect.query_errors.contains(&-440);
        if is_refused { Err(ScpiError::new(-440)) } else { Ok(()) }
    }

    fn cancel_on_reset(&mut self, header: &Header<'_>) {
        if header.is_common && header.text.eq_ignore_ascii_case(b"RST") {
            self.wants_operation_complete = false;
        }
    }

    fn respond(&mut self, heading: &str, values: &[Value]) {
        let Some(last) = values.last() else { return };
        self.message.answer.is_indefinite |= last.is_indefinite();
        let format = self.dialect.real_format;
        self.write_answer(heading, |out| {
            for (index, value) in values.iter().enumerate() {
                if 0 < index {
                    out.push(b',');
                }
                value.write(format, out);
            }
        });
    }

    fn write_answer(&mut self, heading: &str, write: impl FnOnce(&mut Vec<u8>)) {
        let answer = &mut self.message.answer;
        if answer.has_data {
            answer.bytes.push(b';');
        }
        answer.has_data = true;
        answer.bytes.extend_from_slice(heading.as_bytes());
        write(&mut answer.bytes);
        if self.dialect.output_limit_bytes < answer.bytes.len() + self.output.len() {
            answer.bytes.clear();
            answer.has_data = false;
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
        if self.dialect.after_error == AfterError::SkipMessage {
            self.message.skip_rest();
        }
    }
}

impl Message {
    const fn skip_rest(&mut self) {
        self.position = usize::MAX;
    }

    /// The header from the root: a relative one is appended to the path.
    fn absolute(&self, header: &Header<'_>) -> Vec<u8> {
        if header.is_common || header.is_absolute || self.path.is_empty() {
            return header.text.to_vec();
        }
        [&*self.path, b":", header.text].concat()
    }

    /// Makes all but the last mnemonic of `path` the path of the next unit. Common commands belong
    /// to no subsystem and leave it as it is.
    fn enter(&mut self, header: &Header<'_>, mut path: Vec<u8>) {
        if !header.is_common {
            path.truncate(path.iter().rposition(|byte| *byte == b':').unwrap_or(0));
            self.path = path;
        }
    }
}

/// Suffixes and data of a header that was found, as far as the tree says what is right.
fn check<C>(found: Found<'_, C>, data: &[u8]) -> Result<(Vec<Option<u32>>, Vec<Param>), ScpiError> {
    if found.is_out_of_range {
        return Err(ScpiError::new(-114));
    }
    let params = grammar::params(data)?;
    let Arity { min, max } = found.arity;
    if params.len() < min {
        return Err(ScpiError::new(-109));
    }
    if max < params.len() {
        return Err(ScpiError::new(-108));
    }
    Ok((found.suffixes, params))
}

const fn rules(dialect: &Dialect) -> Rules {
    Rules { terminators: dialect.terminators, strings_span_lines: dialect.strings_span_lines }
}

/// The header as it was sent.
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
