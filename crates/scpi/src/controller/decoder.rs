//! Cuts the stream of an instrument into whole answers.

use crate::{controller::response::Response, grammar::scan::Ending};

/// Terminator and largest length of answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Framing {
    /// Ending of an answer. [`Ending::Lf`] and [`Ending::CrLf`]: a line feed; a carriage return
    /// before it is dropped. [`Ending::Cr`]: a carriage return; a line feed after it is dropped.
    pub ending: Ending,
    /// Most bytes of one answer, with its ending.
    pub limit_bytes: usize,
    /// Whether a block without a length is taken up to the ending. If its bytes contain the ending,
    /// the rest looks like the next answer; use it only with a peer that sends text in such blocks.
    pub allows_indefinite_blocks: bool,
}

impl Default for Framing {
    fn default() -> Self {
        Self { ending: Ending::Lf, limit_bytes: 1024 * 1024, allows_indefinite_blocks: false }
    }
}

/// The form of the next answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ExpectedResponse {
    /// Data, in which endings inside strings and blocks do not count.
    #[default]
    Data,
    /// One line of unparsed text, such as an identity whose serial number may begin with `#1`.
    Line,
}

/// Why a stream cannot be followed any further.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// No ending arrived.
    #[error("an answer is longer than {limit_bytes} bytes")]
    TooLong {
        /// The limit of the framing.
        limit_bytes: usize,
    },
    /// A byte beyond ASCII outside a block: a wrong baud rate, or a damaged line.
    #[error("byte 0x{byte:02X} at offset {offset} of an answer is not ASCII")]
    NotAscii {
        /// The unexpected byte.
        byte: u8,
        /// Its place in the answer.
        offset: usize,
    },
    /// The length of a block is not a number.
    #[error("the block at offset {offset} of an answer has no valid length")]
    BlockLength {
        /// The length is damaged.
        offset: usize,
    },
    /// The declared length of a block is not followed by a separator or an ending.
    #[error("a block is followed by 0x{byte:02X} at offset {offset} of an answer")]
    BlockEnd {
        /// The byte that was found.
        byte: u8,
        /// Its place in the answer.
        offset: usize,
    },
    /// A block without a length, which this framing does not allow.
    #[error("the block at offset {offset} of an answer has no length")]
    IndefiniteBlock {
        /// Its place in the answer.
        offset: usize,
    },
}

/// Incremental decoder: bytes go in by [`push`](Self::push), answers come out by
/// [`poll`](Self::poll).
///
/// A fault is sticky. Behind a damaged block the payload may hold endings, so any guess about where
/// the next answer starts can return half a sweep as if it were a reading. The owner of the port
/// must drain it, check the instrument with `*IDN?`, and call [`reset`](Self::reset).
#[derive(Debug, Clone)]
pub struct ResponseDecoder {
    framing: Framing,
    expect: ExpectedResponse,
    // Invariant: `buffer[start..]` begins with the first byte of an answer, and `scanned` bytes of it
    // led to `position`.
    buffer: Vec<u8>,
    start: usize,
    scanned: usize,
    position: Position,
    skips_line_feed: bool,
    fault: Option<FrameError>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Position {
    DataStart,
    Data,
    Text,
    Hash,
    Length { n_digits_left: u8, declared: usize },
    Block { left: usize },
    BlockEnd,
    Indefinite,
}

impl ResponseDecoder {
    /// An empty decoder.
    pub const fn new(framing: Framing) -> Self {
        Self {
            framing,
            expect: ExpectedResponse::Data,
            buffer: Vec::new(),
            start: 0,
            scanned: 0,
            position: Position::DataStart,
            skips_line_feed: false,
            fault: None,
        }
    }

    /// Sets the form of the next answer; data, unless it is set again for each line.
    ///
    /// To be called before its bytes are pushed.
    pub const fn expect(&mut self, expect: ExpectedResponse) {
        self.expect = expect;
    }

    /// Takes bytes in, cut anywhere. After a fault they are dropped.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.fault.is_none() {
            self.buffer.extend_from_slice(bytes);
        }
    }

    /// Returns the next whole answer, or `None` when more bytes are needed.
    ///
    /// # Errors
    /// The fault of the stream, every time from the first until [`Self::reset`].
    pub fn poll(&mut self) -> Result<Option<Response>, FrameError> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        self.skip_line_feed();
        match self.scan() {
            Ok(false) => Ok(None),
            Ok(true) => {
                let response = self.cut(true);
                Ok(Some(response))
            }
            Err(fault) => {
                self.fault = Some(fault);
                self.buffer = Vec::new();
                (self.start, self.scanned) = (0, 0);
                Err(fault)
            }
        }
    }

    /// The transport says that the answer ends here, with or without an ending. Returns it, or
    /// `None` without any byte.
    ///
    /// # Errors
    /// As [`Self::poll`]; an incomplete block is [`FrameError::BlockLength`].
    pub fn end_of_message(&mut self) -> Result<Option<Response>, FrameError> {
        if let Some(response) = self.poll()? {
            return Ok(Some(response));
        }
        if self.scanned == 0 {
            return Ok(None);
        }
        if matches!(self.position, Position::Length { .. } | Position::Block { .. }) {
            let fault = FrameError::BlockLength { offset: self.scanned };
            self.fault = Some(fault);
            return Err(fault);
        }
        Ok(Some(self.cut(false)))
    }

    /// Received bytes of an incomplete answer.
    pub fn n_buffered(&self) -> usize {
        self.buffer.len() - self.start
    }

    /// Forgets all bytes and the fault. The next byte begins an answer.
    pub fn reset(&mut self) {
        *self = Self::new(self.framing);
    }

    fn skip_line_feed(&mut self) {
        if self.skips_line_feed && self.scanned == 0 && self.start < self.buffer.len() {
            self.start += usize::from(self.buffer[self.start] == b'\n');
            self.skips_line_feed = false;
        }
    }

    /// Takes the scanned bytes out as an answer.
    fn cut(&mut self, has_ending: bool) -> Response {
        let end = self.start + self.scanned;
        let mut line = &self.buffer[self.start..end - usize::from(has_ending)];
        let is_lf = self.framing.ending != Ending::Cr;
        if is_lf && self.position != Position::Indefinite {
            line = line.strip_suffix(b"\r").unwrap_or(line);
        }
        let response = Response::new(line.to_vec());
        self.start = end;
        self.scanned = 0;
        self.position = Position::DataStart;
        self.expect = ExpectedResponse::Data;
        self.skips_line_feed = !is_lf;
        // Moving the remaining bytes costs no more than they free.
        if self.buffer.len() <= 2 * self.start {
            self.buffer.drain(..self.start);
            self.start = 0;
        }
        response
    }

    /// Scans the new bytes. True when an answer is complete.
    fn scan(&mut self) -> Result<bool, FrameError> {
        let limit_bytes = self.framing.limit_bytes;
        let too_long = FrameError::TooLong { limit_bytes };
        while self.start + self.scanned < self.buffer.len() {
            if limit_bytes <= self.scanned {
                return Err(too_long);
            }
            if self.skip() {
                continue;
            }
            let offset = self.scanned;
            let byte = self.buffer[self.start + offset];
            let position = self.position;
            self.scanned += 1;
            if self.step(byte, offset)? {
                // How an answer ended decides whether a carriage return belongs to it.
                self.position = position;
                return Ok(true);
            }
        }
        if limit_bytes <= self.scanned { Err(too_long) } else { Ok(false) }
    }

    /// Passes over bytes that cannot change where the scan is. False when there are none.
    fn skip(&mut self) -> bool {
        let end = self.buffer.len().min(self.start.saturating_add(self.framing.limit_bytes));
        let window = &self.buffer[self.start + self.scanned..end];
        let n_skipped = match self.position {
            Position::Block { left } => left.min(window.len()),
            Position::Data | Position::DataStart => {
                window.iter().take_while(|byte| is_plain(**byte)).count()
            }
            _ => 0,
        };
        if n_skipped == 0 {
            return false;
        }
        self.scanned += n_skipped;
        self.position = match self.position {
            Position::Block { left } if left == n_skipped => Position::BlockEnd,
            Position::Block { left } => Position::Block { left: left - n_skipped },
            _ => Position::Data,
        };
        true
    }

    /// One byte outside a counted block. True when it ends the answer.
    fn step(&mut self, byte: u8, offset: usize) -> Result<bool, FrameError> {
        let is_ending = match self.framing.ending {
            Ending::Lf | Ending::CrLf => byte == b'\n',
            Ending::Cr => byte == b'\r',
        };
        if is_ending && !(self.position == Position::Text && self.expect == ExpectedResponse::Data)
        {
            return match self.position {
                Position::Length { .. } => Err(FrameError::BlockLength { offset }),
                _ => Ok(true),
            };
        }
        if self.position == Position::Indefinite {
            return Ok(false);
        }
        if !byte.is_ascii() {
            return Err(FrameError::NotAscii { byte, offset });
        }
        if self.expect == ExpectedResponse::Line {
            return Ok(false);
        }
        self.position = match self.position {
            Position::Text if byte == b'"' => Position::Data,
            Position::Text => Position::Text,
            Position::Hash => match byte {
                b'0' if self.framing.allows_indefinite_blocks => Position::Indefinite,
                b'0' => return Err(FrameError::IndefiniteBlock { offset }),
                b'1'..=b'9' => Position::Length { n_digits_left: byte - b'0', declared: 0 },
                _ => Position::Data,
            },
            Position::Length { n_digits_left, declared } => {
                if !byte.is_ascii_digit() {
                    return Err(FrameError::BlockLength { offset });
                }
                self.length(n_digits_left - 1, declared * 10 + usize::from(byte - b'0'))?
            }
            Position::BlockEnd => match byte {
                b',' | b';' => Position::DataStart,
                b'\r' => Position::BlockEnd,
                _ => return Err(FrameError::BlockEnd { byte, offset }),
            },
            Position::DataStart if byte == b'#' => Position::Hash,
            _ => match byte {
                b'"' => Position::Text,
                b',' | b';' | b' ' => Position::DataStart,
                _ => Position::Data,
            },
        };
        Ok(false)
    }

    fn length(&self, n_digits_left: u8, declared: usize) -> Result<Position, FrameError> {
        // Refused before it is awaited: a damaged length must not hang the exchange.
        if self.framing.limit_bytes <= declared {
            return Err(FrameError::TooLong { limit_bytes: self.framing.limit_bytes });
        }
        Ok(match (n_digits_left, declared) {
            (0, 0) => Position::BlockEnd,
            (0, left) => Position::Block { left },
            _ => Position::Length { n_digits_left, declared },
        })
    }
}

/// A byte that is always data outside strings and blocks.
const fn is_plain(byte: u8) -> bool {
    byte.is_ascii() && !matches!(byte, b'\n' | b'\r' | b'"' | b'#' | b',' | b';' | b' ')
}
