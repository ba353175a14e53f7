//! What may happen between a bench, the hub and the object store.

/// One of the things that happen to a bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Deed {
    /// A run is measured to its end.
    Measure,
    /// The same, in the format of a newer rigd.
    Newer,
    /// The rig is killed in the middle of a run.
    KillRig,
    /// Batches are sent, and the answers are read.
    Send,
    /// The shipper is killed before it has read the journal, or after the answer.
    Kill,
    /// The shipper is killed between sending and the answer.
    KillInFlight,
    /// The program that ships is killed at any moment.
    KillShipper,
    /// The connection is ended by PostgreSQL inside of `ingest`.
    EndInside,
    /// PostgreSQL has no space left for a record inside of `ingest`.
    FullHub,
    /// The answer is lost behind the commit, and the batch is sent again.
    LoseAnswer,
    /// An older batch comes again.
    Repeat,
    /// PostgreSQL crashes while a batch is sent.
    CrashHub,
    /// The line is cut after a drawn number of bytes.
    Cut,
    /// The line keeps every part of a message for a while.
    Slow,
    /// Sealed runs are put in the object store.
    PutObjects,
    /// The program that puts them is killed at any moment.
    KillObjects,
    /// A file of the object store cannot grow beyond a drawn size.
    FullObjects,
    /// The journal is copied.
    BackUp,
    /// The journal is put back to the copy.
    Restore,
}

/// Each with how often it is drawn, relative to the others.
pub(crate) const DEEDS: [(Deed, u32); 19] = [
    (Deed::Measure, 6),
    (Deed::Newer, 2),
    (Deed::KillRig, 4),
    (Deed::Send, 4),
    (Deed::Kill, 2),
    (Deed::KillInFlight, 6),
    (Deed::KillShipper, 6),
    (Deed::EndInside, 5),
    (Deed::FullHub, 3),
    (Deed::LoseAnswer, 4),
    (Deed::Repeat, 4),
    (Deed::CrashHub, 1),
    (Deed::Cut, 6),
    (Deed::Slow, 2),
    (Deed::PutObjects, 2),
    (Deed::KillObjects, 5),
    (Deed::FullObjects, 4),
    (Deed::BackUp, 4),
    (Deed::Restore, 2),
];

/// How the hub is while a run is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum HubState {
    /// Nobody ships.
    None,
    /// It takes what is shipped.
    Well,
    /// Nobody listens at its address.
    Dead,
    /// It takes connections, and says nothing.
    Silent,
}

pub(crate) const HUB_STATES: [HubState; 4] =
    [HubState::None, HubState::Well, HubState::Dead, HubState::Silent];
