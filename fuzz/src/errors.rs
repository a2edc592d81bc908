//! What must hold of errors.

use raybrook::{Error, Result};

/// The longest message. It quotes a file in pieces of 60 characters.
const MESSAGE_BYTES: usize = 4096;

/// What was read; checks the error where there is one.
pub fn readable<T>(result: Result<T>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            check_error(&error);
            None
        }
    }
}

/// An error says something, is short however large the input is, and is none of the file system, which was well.
pub fn check_error(error: &Error) {
    let message = error.to_string();
    assert!((1..MESSAGE_BYTES).contains(&message.len()), "a message of {} bytes", message.len());
    assert!(!matches!(error, Error::Io { .. }), "{message}");
}
