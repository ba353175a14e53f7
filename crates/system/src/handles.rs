//! How many files and connections a program may have open.

use std::io;

/// The number that this program may have open now; `None` without a limit.
///
/// Windows has no limit that a program would meet.
pub fn limit() -> Option<u64> {
    crate::system::handle_limit()
}

/// Takes as many as the system allows. Nothing is to do on Windows.
///
/// # Errors
/// [`io::Error`] if the system refuses; the limit is the old one then.
pub fn take_all() -> io::Result<()> {
    crate::system::take_handles()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_never_lower_than_before() {
        let before = limit();
        take_all().unwrap();
        assert!(limit().unwrap_or(u64::MAX) >= before.unwrap_or(u64::MAX).min(10_240));
    }
}
