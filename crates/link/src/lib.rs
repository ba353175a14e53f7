//! Owns a port: bytes, deadlines, drain, quarantine, and a transcript of the last frames.
//!
//! A [`Port`] is one serial line, one TCP connection, one instrument on USB or one pipe in memory; its holder
//! is its only user. It handles time and bytes; the drivers above know the protocol and the form of an answer.
//! All waiting is done on the runtime's clock, so that a simulated rig may run on a paused one.

mod attached;
mod clock;
mod device;
mod durations;
mod endpoint;
mod error;
mod health;
#[cfg_attr(
    not(target_os = "linux"),
    expect(dead_code, reason = "only a driver of Linux carries whole messages")
)]
mod messages;
mod port;
mod stop;
mod transcript;
mod transport;
#[cfg(target_os = "linux")]
mod usbtmc;

pub use attached::{AttachedPort, Holder, UsbIdentity, attached_ports};
pub use clock::Clock;
pub use device::device_of;
pub use durations::Durations;
pub use endpoint::{Endpoint, Plug};
pub use error::{LineError, OpenError, PartialAnswer, escaped};
pub use health::{Health, HealthMeter};
pub use port::Port;
pub use stop::StopSignal;
pub use transcript::{Flow, Frame, Transcript};
pub use transport::Transport;
