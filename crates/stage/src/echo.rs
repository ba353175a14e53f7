//! Removes the host's own bytes from the received ones.
//!
//! Some RS-485 adapters receive their own bytes. The answer to a write of one register or coil
//! equals the request, so that it looks like an echo; the answers to all other requests differ
//! within their first bytes. The other requests therefore show whether there is an echo.

/// The echo of a line, and the bytes that are held back in the present exchange.
#[derive(Debug, Default)]
pub(crate) struct EchoFilter {
    is_echoing: bool,
    /// The request of the present exchange, until its echo has arrived or not.
    request: Vec<u8>,
    held: Vec<u8>,
}

/// Functions whose answer repeats the request.
const REPEATING: [u8; 2] = [5, 6];

impl EchoFilter {
    /// Whether the line was found to echo.
    pub(crate) const fn is_echoing(&self) -> bool {
        self.is_echoing
    }

    /// A new exchange begins.
    pub(crate) fn begin(&mut self) {
        self.request.clear();
        self.held.clear();
    }

    /// These bytes were sent.
    pub(crate) fn sent(&mut self, bytes: &[u8]) {
        self.request.extend_from_slice(bytes);
    }

    /// Appends to `passed` what of the received bytes is not an echo.
    pub(crate) fn filter(&mut self, received: &[u8], passed: &mut Vec<u8>) {
        if self.request.is_empty() {
            passed.extend_from_slice(received);
            return;
        }
        let is_repeating = self.request.get(1).is_some_and(|f| REPEATING.contains(f));
        if is_repeating && !self.is_echoing {
            self.request.clear();
            passed.extend_from_slice(received);
            return;
        }
        self.held.extend_from_slice(received);
        if self.held.starts_with(&self.request) {
            self.is_echoing = true;
            passed.extend_from_slice(&self.held[self.request.len()..]);
        } else if self.request.starts_with(&self.held) {
            return;
        } else if is_repeating {
            // An echo with a glitch before it looks like the answer. Nothing passes, and the request is repeated.
            self.held.clear();
            return;
        } else {
            self.is_echoing = false;
            passed.append(&mut self.held);
        }
        self.request.clear();
        self.held.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const READ: &[u8] = &[1, 3, 0, 0x7F, 0, 3, 0x34, 0x13];
    const READ_REPLY: &[u8] = &[1, 3, 6, 0, 0, 0, 0, 0, 0, 0x21, 0x75];
    const WRITE: &[u8] = &[1, 6, 0, 0x7D, 0, 0x20, 0x18, 0x0A];

    /// The output for a stream cut in two at every place.
    #[track_caller]
    fn check(filter: impl Fn() -> EchoFilter, request: &[u8], stream: &[u8], expected: &[u8]) {
        for cut in 0..=stream.len() {
            let (mut filter, mut passed) = (filter(), Vec::new());
            filter.begin();
            filter.sent(request);
            filter.filter(&stream[..cut], &mut passed);
            filter.filter(&stream[cut..], &mut passed);
            assert_eq!(passed, expected, "cut at {cut}");
        }
    }

    fn quiet() -> EchoFilter {
        EchoFilter::default()
    }

    fn echoing() -> EchoFilter {
        EchoFilter { is_echoing: true, ..EchoFilter::default() }
    }

    #[test]
    fn the_echo_of_a_read_is_dropped_and_its_answer_passes() {
        for filter in [quiet, echoing] {
            check(filter, READ, READ_REPLY, READ_REPLY);
            check(filter, READ, &[READ, READ_REPLY].concat(), READ_REPLY);
            check(filter, READ, READ, &[]);
        }
    }

    #[test]
    fn a_repeated_write_is_an_answer_on_a_quiet_line_and_an_echo_on_an_echoing_one() {
        check(quiet, WRITE, WRITE, WRITE);
        check(echoing, WRITE, WRITE, &[]);
        check(echoing, WRITE, &[WRITE, WRITE].concat(), WRITE);
        let exception = [1, 0x86, 4, 0x43, 0xA3];
        check(echoing, WRITE, &[WRITE, &exception].concat(), &exception);
    }

    /// The drive drops such a frame.
    #[test]
    fn an_echo_with_a_glitch_before_it_is_no_answer() {
        check(echoing, WRITE, &[&[0x00], WRITE].concat(), &[]);
        check(echoing, WRITE, &[&[0xFF, 0x01], WRITE].concat(), &[]);
    }

    #[test]
    fn a_line_is_known_to_echo_from_its_last_read() {
        let mut filter = quiet();
        for (stream, is_echoing) in [(READ_REPLY, false), (READ, true), (READ_REPLY, false)] {
            filter.begin();
            filter.sent(READ);
            filter.filter(stream, &mut Vec::new());
            assert_eq!(filter.is_echoing(), is_echoing);
        }
    }
}
