//! Moments as text: always UTC to the millisecond, so that their order as text is their order in
//! time.

use jiff::{Timestamp, fmt::temporal::DateTimePrinter};
use serde::Serializer;

const PRINTER: DateTimePrinter = DateTimePrinter::new().precision(Some(3));

/// `2026-03-01T12:00:00.100Z`.
pub fn text(at: Timestamp) -> String {
    PRINTER.timestamp_to_string(&at)
}

/// For serde's `serialize_with`.
pub fn serialize<S: Serializer>(at: &Timestamp, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&text(*at))
}

/// For serde's `serialize_with`: `null` where there is none.
pub fn serialize_if_any<S: Serializer>(at: &Option<Timestamp>, to: S) -> Result<S::Ok, S::Error> {
    match at {
        Some(at) => serialize(at, to),
        None => to.serialize_none(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_sorts_as_time_does() {
        let at = |ms| text(Timestamp::from_millisecond(ms).unwrap());
        assert_eq!(at(1_100), "1970-01-01T00:00:01.100Z");
        let moments = [0, 1, 99, 100, 125, 999, 1_000, 1_010, 60_000];
        assert!(moments.map(at).is_sorted());
    }
}
