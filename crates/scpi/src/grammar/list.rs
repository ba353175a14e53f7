//! Lists in parentheses: channel lists and numeric lists.
//!
//! Module channels and path names, which some switching systems have, are not read.
//!
//! # Source
//! SCPI-99, volume 1, section 8.3.

use nom::{
    IResult, Parser,
    branch::alt,
    bytes::complete::take_while,
    character::complete::{char, digit0, digit1, i32 as whole, one_of},
    combinator::{all_consuming, map_opt, opt, recognize},
    multi::{many0, separated_list1},
    sequence::{delimited, preceded},
};

use crate::{grammar::error::ScpiError, grammar::param::Param};

/// Channels from the first to the last; a single channel is both.
///
/// A channel has a number for each dimension of the switch: `5!3` is row 5, column 3.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelRange {
    first: Vec<i32>,
    last: Vec<i32>,
}

/// Numbers from the first to the last; a single number is both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumericRange {
    /// Where it begins.
    pub first: f64,
    /// Where it ends; may lie below `first`.
    pub last: f64,
}

impl ChannelRange {
    /// The first channel.
    pub fn first(&self) -> &[i32] {
        &self.first
    }

    /// The last channel, with as many dimensions as the first.
    pub fn last(&self) -> &[i32] {
        &self.last
    }

    /// Every channel in the order of a scan: the last dimension runs fastest, each from its first
    /// number to its last, upwards or downwards.
    ///
    /// A short list can name very many channels, so check against those the instrument has while
    /// iterating.
    pub fn channels(&self) -> impl Iterator<Item = Vec<i32>> + use<> {
        let (first, last) = (self.first.clone(), self.last.clone());
        std::iter::successors(Some(first.clone()), move |channel| {
            let mut next = channel.clone();
            for dimension in (0..next.len()).rev() {
                let end = last[dimension];
                if next[dimension] != end {
                    next[dimension] += (end - first[dimension]).signum();
                    return Some(next);
                }
                next[dimension] = first[dimension];
            }
            None
        })
    }
}

impl Param {
    /// The ranges of a channel list, such as `(@1,2!5:3!6)`.
    ///
    /// # Errors
    /// −171 for another expression, and the "not allowed" number of other types.
    pub fn channels(&self) -> Result<Vec<ChannelRange>, ScpiError> {
        self.list(preceded(padded('@'), separated_list1(padded(','), channel_range)))
    }

    /// The ranges of a numeric list, such as `(1,3:9)`.
    ///
    /// # Errors
    /// −171 for another expression, and the "not allowed" number of other types.
    pub fn numeric_list(&self) -> Result<Vec<NumericRange>, ScpiError> {
        self.list(separated_list1(padded(','), numeric_range))
    }

    fn list<'a, T>(
        &'a self,
        items: impl Parser<&'a str, Output = Vec<T>, Error = nom::error::Error<&'a str>>,
    ) -> Result<Vec<T>, ScpiError> {
        let Self::Expression(inside) = self else { return Err(self.not_allowed()) };
        match all_consuming(items).parse(inside) {
            Ok((_, items)) => Ok(items),
            Err(_) => Err(ScpiError::new(-171)),
        }
    }
}

type Parsed<'a, T> = IResult<&'a str, T>;

fn blank(input: &str) -> Parsed<'_, &str> {
    take_while(|c: char| c.is_ascii_whitespace()).parse(input)
}

fn padded<'a>(
    symbol: char,
) -> impl Parser<&'a str, Output = char, Error = nom::error::Error<&'a str>> {
    delimited(blank, char(symbol), blank)
}

fn channel(input: &str) -> Parsed<'_, Vec<i32>> {
    separated_list1(padded('!'), whole).parse(input)
}

fn channel_range(input: &str) -> Parsed<'_, ChannelRange> {
    let range = (delimited(blank, channel, blank), opt(preceded(padded(':'), channel)), blank);
    map_opt(range, |(first, last, _)| {
        let last = last.unwrap_or_else(|| first.clone());
        // The distance must fit too, since a scan walks it.
        let is_range = first.len() == last.len()
            && first.iter().zip(&last).all(|(first, last)| last.checked_sub(*first).is_some());
        is_range.then_some(ChannelRange { first, last })
    })
    .parse(input)
}

fn number(input: &str) -> Parsed<'_, f64> {
    let digits =
        alt((recognize((digit1, opt((char('.'), digit0)))), recognize((char('.'), digit1))));
    let exponent = (one_of("eE"), opt(one_of("+-")), digit1);
    let number = recognize((opt(one_of("+-")), digits, opt(exponent)));
    map_opt(number, |text: &str| text.parse().ok().filter(|value: &f64| value.is_finite()))
        .parse(input)
}

fn numeric_range(input: &str) -> Parsed<'_, NumericRange> {
    (delimited(blank, number, blank), opt(preceded(padded(':'), number)), many0(one_of(" \t")))
        .map(|(first, last, _)| NumericRange { first, last: last.unwrap_or(first) })
        .parse(input)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn channels(inside: &str) -> Result<Vec<Vec<i32>>, i16> {
        let ranges = Param::Expression(inside.into()).channels();
        let ranges = ranges.map_err(|error| error.number())?;
        Ok(ranges.iter().flat_map(ChannelRange::channels).collect())
    }

    #[test]
    fn a_channel_list_is_scanned_in_its_order() {
        assert_eq!(channels("@1,2,3:5"), Ok(vec![vec![1], vec![2], vec![3], vec![4], vec![5]]));
        assert_eq!(channels("@ 3 : 1 "), Ok(vec![vec![3], vec![2], vec![1]]));
        let block = [[2, 6], [2, 5], [3, 6], [3, 5]].map(Vec::from).to_vec();
        assert_eq!(channels("@2!6:3!5"), Ok(block));
        assert_eq!(channels("@-1!+2"), Ok(vec![vec![-1, 2]]));
        for wrong in ["@", "@1,", "@1:2!3", "1,2", "@a", "@1:2:3", "@-2147483648:2147483647"] {
            assert_eq!(channels(wrong), Err(-171), "{wrong}");
        }
        assert_eq!(Param::NonDecimal(1).channels().map_err(|error| error.number()), Err(-128));
        // A list that names more channels than there is time for is read all the same.
        let ranges = Param::Expression("@1:2000000000".into()).channels().expect("a list");
        assert_eq!(ranges[0].channels().nth(2), Some(vec![3]));
    }

    #[test]
    fn a_numeric_list_keeps_its_ranges() {
        let list = |inside: &str| {
            let ranges = Param::Expression(inside.into()).numeric_list();
            ranges.map(|ranges| ranges.iter().map(|r| (r.first, r.last)).collect::<Vec<_>>())
        };
        assert_eq!(list("1,3:9"), Ok(vec![(1.0, 1.0), (3.0, 9.0)]));
        assert_eq!(list(" -1.5e3 : .5 , 2. "), Ok(vec![(-1500.0, 0.5), (2.0, 2.0)]));
        for wrong in ["", "@1", "1,,2", "1:", "1e999", "1 2"] {
            assert_eq!(list(wrong).map_err(|error| error.number()), Err(-171), "{wrong}");
        }
    }
}
