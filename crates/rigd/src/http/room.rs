//! How many clients there is room for.

use rig_system::handles;

/// A page and a program have one stream each; this is a crowd of both.
const STREAMS_MAX: usize = 1024;
/// One named token gets this part of the streams at most: a display on every bench of a laboratory, and not all that there
/// is.
const PART_OF_TOKEN: usize = 4;
/// A page in a browser has up to six connections, a script one or two.
const OTHERS: usize = 128;
/// Handles for files, devices, the journal, and connections beyond the limit.
const RESERVE: usize = 256;

/// Event streams and connections that may be open at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Room {
    pub(super) streams: usize,
    /// The streams of one named token.
    pub(super) streams_of_token: usize,
    /// All connections, streams among them.
    pub(super) connections: usize,
}

impl Room {
    /// With the handles that the system gives this program.
    pub(super) fn now() -> Self {
        Self::with(handles::limit())
    }

    fn with(handles: Option<u64>) -> Self {
        let handles = handles.and_then(|handles| usize::try_from(handles).ok());
        let left = handles.unwrap_or(usize::MAX).saturating_sub(RESERVE + OTHERS);
        let streams = left.min(STREAMS_MAX);
        let streams_of_token = streams.div_ceil(PART_OF_TOKEN);
        Self { streams, streams_of_token, connections: streams + OTHERS }
    }
}

/// Takes as many handles as the system allows: the usual limit is made for programs that use `select`.
pub(crate) fn take_handles() {
    if let Err(error) = handles::take_all() {
        tracing::warn!(%error, "the number of handles of this program cannot be raised");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_handles_leave_room_for_requests_and_none_for_streams() {
        let room = |handles: Option<u64>| {
            let Room { streams, streams_of_token, connections } = Room::with(handles);
            [streams, streams_of_token, connections]
        };
        assert_eq!(room(None), [1024, 256, 1152]);
        assert_eq!(room(Some(20_000)), [1024, 256, 1152]);
        assert_eq!(room(Some(1024)), [640, 160, 768]);
        assert_eq!(room(Some(256)), [0, 0, 128]);
    }
}
