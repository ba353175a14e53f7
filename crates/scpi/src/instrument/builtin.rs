//! The built-in commands of every instrument: common commands, error queue, status registers.

use std::sync::LazyLock;

use super::{BlockedBy, Instrument};
use crate::{
    grammar::error::{ErrorClass, ErrorQueue, ScpiError},
    grammar::param::Param,
    grammar::value::{Value, write_quoted},
    instrument::dialect::{Dialect, ErrorFormat},
    instrument::status::{REGISTER_MASK, Register},
    instrument::tree::{Node, Tree, command, query, setting},
};

/// A command that needs no host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Builtin {
    ClearStatus,
    EventEnable,
    EventStatus,
    Identity,
    OperationComplete,
    Reset,
    ServiceEnable,
    StatusByte,
    SelfTest,
    Wait,
    NextError,
    AllErrors,
    ErrorCount,
    Version,
    Preset,
    Header,
    Event(ScpiRegister),
    Condition(ScpiRegister),
    Enable(ScpiRegister),
    PositiveTransition(ScpiRegister),
    NegativeTransition(ScpiRegister),
}

/// One of the two registers of SCPI.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ScpiRegister {
    Operation,
    Questionable,
}

use ScpiRegister::{Operation, Questionable};

/// Every built-in command; [`has`] says which of them a dialect knows.
pub(super) static TREE: LazyLock<Tree<Builtin>> = LazyLock::new(|| {
    Tree::new(COMMANDS).expect("the patterns are constants, and every test looks them up")
});

const COMMANDS: &[Node<Builtin>] = &[
    command("*CLS", Builtin::ClearStatus),
    setting("*ESE", Builtin::EventEnable).asks(0, 0),
    query("*ESR", Builtin::EventStatus),
    query("*IDN", Builtin::Identity),
    setting("*OPC", Builtin::OperationComplete).takes(0, 0).asks(0, 0),
    command("*RST", Builtin::Reset),
    setting("*SRE", Builtin::ServiceEnable).asks(0, 0),
    query("*STB", Builtin::StatusByte),
    query("*TST", Builtin::SelfTest),
    command("*WAI", Builtin::Wait),
    setting(":HEADer", Builtin::Header).asks(0, 0),
    query(":SYSTem:ERRor[:NEXT]", Builtin::NextError),
    query(":SYSTem:ERRor:ALL", Builtin::AllErrors),
    query(":SYSTem:ERRor:COUNt", Builtin::ErrorCount),
    query(":SYSTem:VERSion", Builtin::Version),
    command(":STATus:PRESet", Builtin::Preset),
    query(":STATus:OPERation[:EVENt]", Builtin::Event(Operation)),
    query(":STATus:OPERation:CONDition", Builtin::Condition(Operation)),
    setting(":STATus:OPERation:ENABle", Builtin::Enable(Operation)).asks(0, 0),
    setting(":STATus:OPERation:PTRansition", Builtin::PositiveTransition(Operation)).asks(0, 0),
    setting(":STATus:OPERation:NTRansition", Builtin::NegativeTransition(Operation)).asks(0, 0),
    query(":STATus:QUEStionable[:EVENt]", Builtin::Event(Questionable)),
    query(":STATus:QUEStionable:CONDition", Builtin::Condition(Questionable)),
    setting(":STATus:QUEStionable:ENABle", Builtin::Enable(Questionable)).asks(0, 0),
    setting(":STATus:QUEStionable:PTRansition", Builtin::PositiveTransition(Questionable))
        .asks(0, 0),
    setting(":STATus:QUEStionable:NTRansition", Builtin::NegativeTransition(Questionable))
        .asks(0, 0),
];

/// Whether an instrument of this dialect knows the command. Common commands are mandatory.
pub(super) const fn has(dialect: &Dialect, builtin: Builtin) -> bool {
    match builtin {
        Builtin::NextError | Builtin::AllErrors | Builtin::ErrorCount => {
            dialect.error_queue.is_some()
        }
        Builtin::Version => dialect.scpi_version.is_some(),
        Builtin::Header => dialect.headers.is_some(),
        Builtin::Preset
        | Builtin::Event(_)
        | Builtin::Condition(_)
        | Builtin::Enable(_)
        | Builtin::PositiveTransition(_)
        | Builtin::NegativeTransition(_) => dialect.has_status_registers,
        Builtin::ClearStatus
        | Builtin::EventEnable
        | Builtin::EventStatus
        | Builtin::Identity
        | Builtin::OperationComplete
        | Builtin::Reset
        | Builtin::ServiceEnable
        | Builtin::StatusByte
        | Builtin::SelfTest
        | Builtin::Wait => true,
    }
}

/// Longest description that `SYSTem:ERRor?` may answer, in characters.
const DESCRIPTION_MAX: usize = 255;

impl<C: Copy> Instrument<C> {
    pub(super) fn run_builtin(
        &mut self,
        builtin: Builtin,
        is_query: bool,
        params: &[Param],
        heading: &str,
    ) -> Result<(), ScpiError> {
        let value = match builtin {
            Builtin::OperationComplete if is_query => {
                self.session.blocked_by = Some(BlockedBy::OperationsThenAnswer);
                return Ok(());
            }
            Builtin::NextError => {
                self.answer_errors(heading, 1);
                return Ok(());
            }
            Builtin::AllErrors => {
                self.answer_errors(heading, usize::MAX);
                return Ok(());
            }
            _ if is_query => self.ask(builtin),
            _ => return self.tell(builtin, params.first()),
        };
        self.respond(heading, &[value]);
        Ok(())
    }

    fn ask(&mut self, builtin: Builtin) -> Value {
        match builtin {
            Builtin::EventEnable => Value::Integer(self.status.event_enable.into()),
            Builtin::EventStatus => Value::Integer(self.status.take_standard_event().into()),
            Builtin::ServiceEnable => Value::Integer(self.status.service_enable().into()),
            Builtin::StatusByte => Value::Integer(self.status_byte().into()),
            Builtin::Identity => Value::ArbitraryAscii(self.dialect.identity.clone().into()),
            Builtin::Version => Value::Verbatim(self.dialect.scpi_version.unwrap_or("").into()),
            Builtin::Header => Value::Characters(if self.has_headers { "ON" } else { "OFF" }),
            Builtin::ErrorCount => {
                let n_errors = self.errors.as_ref().map_or(0, ErrorQueue::len);
                Value::Integer(n_errors.try_into().unwrap_or(i64::MAX))
            }
            Builtin::Event(which) => Value::Integer(self.register(which).take_event().into()),
            Builtin::Condition(which) => Value::Integer(self.register(which).condition().into()),
            Builtin::Enable(which) => Value::Integer(self.register(which).enable.into()),
            Builtin::PositiveTransition(which) => {
                Value::Integer(self.register(which).positive_transition.into())
            }
            Builtin::NegativeTransition(which) => {
                Value::Integer(self.register(which).negative_transition.into())
            }
            // The self-test of a host that has none always passes.
            Builtin::SelfTest => Value::Integer(0),
            Builtin::ClearStatus
            | Builtin::OperationComplete
            | Builtin::Reset
            | Builtin::Wait
            | Builtin::NextError
            | Builtin::AllErrors
            | Builtin::Preset => Value::Integer(0),
        }
    }

    fn tell(&mut self, builtin: Builtin, param: Option<&Param>) -> Result<(), ScpiError> {
        match builtin {
            Builtin::ClearStatus => {
                self.status.clear_events();
                self.wants_operation_complete = false;
                if let Some(errors) = &mut self.errors {
                    errors.clear();
                }
            }
            Builtin::OperationComplete if self.is_operation_pending => {
                self.wants_operation_complete = true;
            }
            Builtin::OperationComplete => {
                self.status.raise(ErrorClass::OperationComplete.event_bit());
            }
            Builtin::Wait => self.session.blocked_by = Some(BlockedBy::Operations),
            Builtin::Preset => self.status.preset(),
            Builtin::EventEnable => self.status.event_enable = byte(param)?,
            Builtin::ServiceEnable => {
                let mask = byte(param)?;
                self.status.set_service_enable(mask);
            }
            Builtin::Header => self.has_headers = required(param)?.boolean()?,
            Builtin::Enable(which) => self.register(which).enable = mask(param)?,
            Builtin::PositiveTransition(which) => {
                self.register(which).positive_transition = mask(param)?;
            }
            Builtin::NegativeTransition(which) => {
                self.register(which).negative_transition = mask(param)?;
            }
            // A host without settings has nothing to reset.
            Builtin::Reset => {}
            Builtin::EventStatus
            | Builtin::Identity
            | Builtin::StatusByte
            | Builtin::SelfTest
            | Builtin::NextError
            | Builtin::AllErrors
            | Builtin::ErrorCount
            | Builtin::Version
            | Builtin::Event(_)
            | Builtin::Condition(_) => {}
        }
        Ok(())
    }

    fn register(&mut self, which: ScpiRegister) -> &mut Register {
        match which {
            Operation => &mut self.status.operation,
            Questionable => &mut self.status.questionable,
        }
    }

    /// Takes up to `n_max` errors from the queue; at least "no error" is answered.
    fn answer_errors(&mut self, heading: &str, n_max: usize) {
        let mut reports = Vec::new();
        while reports.len() < n_max
            && let Some(error) = self.errors.as_mut().and_then(ErrorQueue::pop)
        {
            reports.push(error);
        }
        if reports.is_empty() {
            reports.push(ScpiError::new(0));
        }
        let format = self.dialect.error_format;
        let answer = &mut self.session.message.answer;
        answer.begin(heading);
        for (index, error) in reports.iter().enumerate() {
            if 0 < index {
                answer.bytes.push(b',');
            }
            write_error(error, format, &mut answer.bytes);
        }
        self.limit_output();
    }
}

/// `-113,"Undefined header;FOO:BAR?"`.
fn write_error(error: &ScpiError, format: ErrorFormat, out: &mut Vec<u8>) {
    let number = error.number();
    if format.has_plus && 0 <= number {
        out.push(b'+');
    }
    out.extend_from_slice(number.to_string().as_bytes());
    out.push(b',');
    let mut description = error.text().to_owned();
    if let Some(info) = error.info().filter(|_| format.has_info) {
        description.push(';');
        let is_printable = |c: &char| c.is_ascii_graphic() || *c == ' ';
        description.extend(info.chars().filter(is_printable));
        description.truncate(DESCRIPTION_MAX);
    }
    write_quoted(&description, out);
}

fn required(param: Option<&Param>) -> Result<&Param, ScpiError> {
    param.ok_or(ScpiError::new(-109))
}

fn byte(param: Option<&Param>) -> Result<u8, ScpiError> {
    let value = required(param)?.integer(0..=255)?;
    u8::try_from(value).map_err(|_| ScpiError::new(-222))
}

fn mask(param: Option<&Param>) -> Result<u16, ScpiError> {
    let value = required(param)?.integer(0..=0xFFFF)?;
    u16::try_from(value).map(|mask| mask & REGISTER_MASK).map_err(|_| ScpiError::new(-222))
}
