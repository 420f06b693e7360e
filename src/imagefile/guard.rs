//! Decoders that others wrote.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What `decode` returns. A panic of the decoder means that the file cannot be read, no more.
///
/// The decoder must run on the calling thread: a panic elsewhere is nobody's to catch.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    // What the decoder leaves half done is never seen again.
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|panic| {
        Err(format!("cannot be decoded; its decoder failed: {}", message(panic.as_ref())))
    })
}

/// What a panic said.
fn message(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it gave no reason")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_a_decoder_is_an_error() {
        assert_eq!(guarded(|| Ok(3)), Ok(3));
        assert_eq!(guarded::<()>(|| Err("short".to_owned())), Err("short".to_owned()));
        let rows: [u8; 2] = [0; 2];
        for row in [2, 3] {
            let error = guarded(|| Ok(rows[std::hint::black_box(row)])).unwrap_err();
            assert!(error.contains("cannot be decoded") && error.contains("out of bounds"));
        }
        let error = guarded::<()>(|| panic!("plain")).unwrap_err();
        assert!(error.ends_with(": plain"), "{error}");
    }
}
