//! Clocks that the standard library does not have.

use std::time::Duration;

/// Time since the computer was started, with its sleep. Only differences count.
///
/// On Windows it begins with the first call of the program.
pub fn running() -> Duration {
    crate::system::running()
}

/// Processor time of the calling thread, which does not depend on other load.
///
/// Windows counts that time in ticks of 16 ms, which is longer than what is measured with it: there it is the time that passes,
/// with what other programs take.
pub fn of_thread() -> Duration {
    crate::system::of_thread()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clocks_do_not_go_back() {
        for clock in [running, of_thread] {
            let before = clock();
            assert!(clock() >= before);
        }
    }
}
