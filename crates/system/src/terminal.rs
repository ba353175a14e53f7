//! The terminal of a person.

/// Whether a line can be drawn again on stderr, by escape sequences. Only for a stderr that is a terminal.
///
/// Every terminal of Unix takes them. A console of Windows must be told first, which this does; one before Windows 10
/// cannot.
pub fn can_redraw() -> bool {
    crate::system::can_redraw()
}

/// Columns of the terminal on stderr; `None` if it does not say.
pub fn columns() -> Option<usize> {
    crate::system::columns()
}

/// Discards what was typed and not read. Only for a stdin that is a terminal. A failure is left to the read that follows.
pub fn forget_input() {
    crate::system::forget_input();
}
