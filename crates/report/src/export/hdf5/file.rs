//! The bytes of an HDF5 file: groups of one-dimensional datasets with attributes, in one piece.
//!
//! # Source
//! HDF5 File Format Specification 3.0, The HDF Group: superblock version 0, object headers version 1, and
//! the messages named below, and one global heap with the texts of all attributes. Nothing in these needs a
//! checksum or an index.

use std::collections::BTreeSet;

/// An address that points nowhere.
const UNDEFINED: u64 = u64::MAX;
/// Bytes of the superblock, behind which the heap begins.
const SUPERBLOCK: usize = 96;
/// The least bytes of a global heap.
const HEAP_MIN: usize = 4096;
/// Bytes of the head of a global heap, and of each object in it.
const HEAP_HEAD: usize = 16;
/// Place of the end of the file in the superblock.
const END_OF_FILE: usize = 40;
/// Place of the address of the root group in the superblock.
const ROOT: usize = 64;

/// The type of the values of a dataset or an attribute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataType {
    /// Eight bytes with a sign.
    Whole,
    /// One byte with a sign.
    Byte,
    /// Eight bytes of IEEE 754.
    Double,
    /// UTF-8 of this length, filled up with zeros.
    Text(u32),
    /// UTF-8 in the global heap.
    InHeap,
}

/// An attribute of a group or a dataset.
#[derive(Debug, Clone)]
pub(super) struct Attribute {
    name: &'static str,
    data_type: DataType,
    bytes: Vec<u8>,
}

/// A message of an object header.
struct Message {
    number: u16,
    bytes: Vec<u8>,
}

/// A file that grows at its end.
#[derive(Debug)]
pub(super) struct Hdf5File {
    bytes: Vec<u8>,
    /// The texts of the heap, in its order.
    texts: BTreeSet<String>,
}

impl Attribute {
    pub(super) fn whole(name: &'static str, value: i64) -> Self {
        Self { name, data_type: DataType::Whole, bytes: value.to_le_bytes().to_vec() }
    }

    /// Attribute message, version 3.
    fn message(&self) -> Message {
        let (data_type, space) = (self.data_type.bytes(), [2, 0, 0, 0]);
        let name = [self.name.as_bytes(), &[0]].concat();
        let mut bytes = vec![3, 0];
        for part in [&name[..], &data_type, &space] {
            bytes.extend(short(part.len()));
        }
        let utf8 = [1];
        bytes.extend([&utf8[..], &name, &data_type, &space, &self.bytes].concat());
        Message { number: 0x000C, bytes }
    }
}

impl DataType {
    /// Datatype message, version 1.
    fn bytes(self) -> Vec<u8> {
        let (class_and_bits, size, properties): ([u8; 4], u32, Vec<u8>) = match self {
            Self::Whole => ([0x10, 0x08, 0, 0], 8, vec![0, 0, 64, 0]),
            Self::Byte => ([0x10, 0x08, 0, 0], 1, vec![0, 0, 8, 0]),
            Self::Double => {
                // Sign at bit 63, exponent of 11 bits at 52 with the bias 1023, mantissa of 52 bits at 0
                // with an implied first bit.
                let bias = 1023_u32.to_le_bytes();
                ([0x11, 0x20, 63, 0], 8, [&[0, 0, 64, 0, 52, 11, 0, 52][..], &bias].concat())
            }
            Self::Text(length) => ([0x13, 0x11, 0, 0], length, Vec::new()),
            // Of variable length, with unsigned bytes.
            Self::InHeap => ([0x19, 1, 1, 0], 16, vec![0x10, 0, 0, 0, 1, 0, 0, 0, 0, 0, 8, 0]),
        };
        [&class_and_bits[..], &size.to_le_bytes(), &properties].concat()
    }
}

impl Hdf5File {
    /// A file whose attributes have these texts.
    pub(super) fn new(texts: BTreeSet<String>) -> Self {
        let mut objects = Vec::new();
        for (index, text) in texts.iter().enumerate() {
            objects.extend([short(index + 1), [1, 0], [0; 2], [0; 2]].concat());
            objects.extend(long(text.len() as u64));
            objects.extend_from_slice(text.as_bytes());
            objects.resize(objects.len().next_multiple_of(8), 0);
        }
        let size = HEAP_MIN.max(objects.len() + 2 * HEAP_HEAD);
        let free = size - HEAP_HEAD - objects.len();
        // The object 0 is the free space.
        objects.extend([[0; 8], long(free as u64)].concat());
        let mut bytes = vec![0; SUPERBLOCK];
        bytes.extend([&b"GCOL"[..], &[1, 0, 0, 0], &long(size as u64), &objects].concat());
        bytes.resize(SUPERBLOCK + size, 0);
        Self { bytes, texts }
    }

    /// An attribute with one of the texts of the file.
    pub(super) fn text(&self, name: &'static str, value: &str) -> Attribute {
        let index = self.texts.iter().position(|text| text == value).map_or(0, |at| at + 1);
        let (length, index) = (length_of(value.as_bytes()), u32::try_from(index).unwrap_or(0));
        let bytes = [&length.to_le_bytes()[..], &long(SUPERBLOCK as u64), &index.to_le_bytes()];
        Attribute { name, data_type: DataType::InHeap, bytes: bytes.concat() }
    }

    /// Writes a dataset of `rows` values, and returns its address.
    pub(super) fn dataset(
        &mut self,
        data_type: DataType,
        rows: usize,
        data: &[u8],
        attributes: &[Attribute],
    ) -> u64 {
        let at = if data.is_empty() { UNDEFINED } else { self.end() };
        self.bytes.extend_from_slice(data);
        let space = [&[1, 1, 0, 0, 0, 0, 0, 0][..], &long(rows as u64)].concat();
        // Allocated early, written on allocation, with the default value.
        let fill = vec![2, 1, 0, 1, 0, 0, 0, 0];
        let layout = [&[3, 1][..], &long(at), &long(data.len() as u64)].concat();
        let messages = [
            Message { number: 0x0001, bytes: space },
            Message { number: 0x0003, bytes: data_type.bytes() },
            Message { number: 0x0005, bytes: fill },
            Message { number: 0x0008, bytes: layout },
        ];
        self.object(messages, attributes)
    }

    /// Writes a group of these objects, and returns its address.
    pub(super) fn group(&mut self, links: &[(&str, u64)], attributes: &[Attribute]) -> u64 {
        // Link info, version 0: the links are in the header, and there are no indices.
        let info = [&[0, 0][..], &long(UNDEFINED), &long(UNDEFINED)].concat();
        let info = Message { number: 0x0002, bytes: info };
        let hard_link = |&(name, address): &(&str, u64)| {
            let length = u8::try_from(name.len()).unwrap_or(u8::MAX);
            let bytes = [&[1, 0, length][..], name.as_bytes(), &long(address)].concat();
            Message { number: 0x0006, bytes }
        };
        let messages: Vec<_> = std::iter::once(info).chain(links.iter().map(hard_link)).collect();
        self.object(messages, attributes)
    }

    /// Writes an object header, version 1.
    fn object(
        &mut self,
        messages: impl IntoIterator<Item = Message>,
        attributes: &[Attribute],
    ) -> u64 {
        let (mut body, mut count) = (Vec::new(), 0);
        for Message { number, mut bytes } in
            messages.into_iter().chain(attributes.iter().map(Attribute::message))
        {
            bytes.resize(bytes.len().next_multiple_of(8), 0);
            body.extend([short(usize::from(number)), short(bytes.len()), [0; 2], [0; 2]].concat());
            body.extend(bytes);
            count += 1;
        }
        let at = self.end();
        let references = 1_u32.to_le_bytes();
        self.bytes.extend([&[1, 0][..], &short(count), &references].concat());
        self.bytes.extend([length_of(&body).to_le_bytes(), [0; 4]].concat());
        self.bytes.extend(body);
        at
    }

    /// The whole file with this root group.
    pub(super) fn finish(mut self, root: u64) -> Vec<u8> {
        let end = self.end();
        self.bytes[..8].copy_from_slice(b"\x89HDF\r\n\x1a\n");
        // Versions 0; addresses and lengths of eight bytes; the usual sizes of nodes, of which there are none.
        self.bytes[8..24].copy_from_slice(&[0, 0, 0, 0, 0, 8, 8, 0, 4, 0, 16, 0, 0, 0, 0, 0]);
        for (at, address) in
            [(24, 0), (32, UNDEFINED), (END_OF_FILE, end), (48, UNDEFINED), (56, 0), (ROOT, root)]
        {
            self.bytes[at..at + 8].copy_from_slice(&long(address));
        }
        self.bytes
    }

    /// The end of the file so far, at a multiple of eight bytes.
    fn end(&mut self) -> u64 {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        self.bytes.len() as u64
    }
}

fn length_of(bytes: &[u8]) -> u32 {
    u32::try_from(bytes.len()).unwrap_or(u32::MAX)
}

/// Lengths here are of names, types and single messages.
fn short(number: usize) -> [u8; 2] {
    u16::try_from(number).unwrap_or(u16::MAX).to_le_bytes()
}

const fn long(number: u64) -> [u8; 8] {
    number.to_le_bytes()
}
