//! Where and when on Earth, as users write it: `LAT,LON,TIME`.

use std::ops::RangeInclusive;
use std::str::FromStr;

/// What is expected of the whole text; ends the messages about its form.
const FORM: &str = "expected LAT,LON,TIME, for example 48.1,11.6,2026-06-21T12:00:00Z";
/// What is expected of the time.
const TIME_FORM: &str = "expected a date and time by RFC 3339 in UTC or with an offset, \
    for example 2026-06-21T12:00:00Z or 2026-06-21T14:00:00+02:00";
/// Minutes of a day.
const MINUTES_PER_DAY: f64 = 1440.0;
/// So many characters of a wrong value are repeated in a message.
const QUOTED_CHARACTERS: usize = 40;

/// A place on Earth and a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceAndTime {
    /// Geographic latitude in degrees, north positive, −90 to 90.
    pub latitude: f64,
    /// Geographic longitude in degrees, east positive, −180 to 180.
    pub longitude: f64,
    /// Julian day: days and fractions since noon UTC of −4712 January 1, in UTC.
    pub julian_day: f64,
}

impl FromStr for PlaceAndTime {
    type Err = String;

    /// Reads `LAT,LON,TIME`: two numbers of degrees, and a time by RFC 3339.
    ///
    /// # Errors
    ///
    /// A sentence that says which part is wrong and what is expected there.
    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<&str> = text.splitn(4, ',').map(str::trim).collect();
        let [latitude, longitude, time] = parts[..] else {
            return Err(format!(
                "{} does not have three parts separated by commas; {FORM}",
                quoted(text)
            ));
        };
        Ok(Self {
            latitude: degrees("latitude", latitude, 90.0, "north")?,
            longitude: degrees("longitude", longitude, 180.0, "east")?,
            julian_day: julian_day(time)?,
        })
    }
}

/// The first characters of a wrong value between quotation marks, control characters escaped.
fn quoted(text: &str) -> String {
    let mut start: String = text.chars().take(QUOTED_CHARACTERS).collect();
    if start.len() < text.len() {
        start.push('…');
    }
    format!("{start:?}")
}

/// A number of degrees from −`limit` to `limit`.
fn degrees(name: &str, text: &str, limit: f64, positive: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| value.abs() <= limit);
    value.ok_or_else(|| {
        format!(
            "the {name} {} is not a number of degrees from -{limit} to {limit}, \
             {positive} positive; {FORM}",
            quoted(text)
        )
    })
}

/// The Julian day of a time by RFC 3339 (§5.6): `YYYY-MM-DDThh:mm:ss[.fraction](Z|±hh:mm)`.
fn julian_day(text: &str) -> Result<f64, String> {
    let wrong = |what: &str| format!("the time {} {what}; {TIME_FORM}", quoted(text));
    let mut rest = Reader { rest: text.as_bytes() };
    let day = rest.date().ok_or_else(|| wrong("does not begin with a date that exists"))?;
    if !rest.skip(b"Tt") {
        return Err(wrong("has no T between date and time of day"));
    }
    let minute =
        rest.time_of_day().ok_or_else(|| wrong("has no time of day from 00:00:00 to 23:59:59"))?;
    let offset = rest
        .offset()
        .ok_or_else(|| wrong("does not end with Z or an offset from UTC such as +02:00"))?;
    Ok(day + (minute - offset) / MINUTES_PER_DAY)
}

/// Julian day of 0 h of a date of the Gregorian calendar (Meeus, Astronomical Algorithms,
/// 2nd ed., eq. 7.1).
fn julian_day_of_date(year: u32, month: u32, day: u32) -> f64 {
    let (year, month) = (f64::from(year), f64::from(month));
    let (year, month) = if month <= 2.0 { (year - 1.0, month + 12.0) } else { (year, month) };
    let century = (year / 100.0).floor();
    let gregorian = 2.0 - century + (century / 4.0).floor();
    let days_of_years = (365.25 * (year + 4716.0)).floor();
    let days_of_months = (30.6001 * (month + 1.0)).floor();
    days_of_years + days_of_months + f64::from(day) + gregorian - 1524.5
}

/// Number of days of a month of the Gregorian calendar.
fn days_of_month(year: u32, month: u32) -> u32 {
    let is_leap = year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    match month {
        2 if is_leap => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// What is still to be read of a time.
struct Reader<'a> {
    rest: &'a [u8],
}

impl Reader<'_> {
    /// Takes one of the given characters, if it comes next.
    fn skip(&mut self, any_of: &[u8]) -> bool {
        let is_there = self.rest.first().is_some_and(|byte| any_of.contains(byte));
        if is_there {
            self.rest = &self.rest[1..];
        }
        is_there
    }

    /// Takes a number of exactly `digits` digits within a range.
    fn number(&mut self, digits: usize, range: RangeInclusive<u32>) -> Option<u32> {
        let (number, rest) = self.rest.split_at_checked(digits)?;
        self.rest = rest;
        let is_digits = number.iter().all(u8::is_ascii_digit);
        let value = is_digits
            .then(|| number.iter().fold(0, |value, digit| 10 * value + u32::from(digit - b'0')))?;
        range.contains(&value).then_some(value)
    }

    /// Takes a number of two digits, and the separator before it.
    fn next_two(&mut self, separator: u8, range: RangeInclusive<u32>) -> Option<u32> {
        if self.skip(&[separator]) { self.number(2, range) } else { None }
    }

    /// `YYYY-MM-DD` as Julian day of its begin.
    fn date(&mut self) -> Option<f64> {
        let year = self.number(4, 0..=9999)?;
        let month = self.next_two(b'-', 1..=12)?;
        let day = self.next_two(b'-', 1..=days_of_month(year, month))?;
        Some(julian_day_of_date(year, month, day))
    }

    /// `hh:mm:ss[.fraction]` in minutes; RFC 3339 allows the second 60 for leap seconds.
    fn time_of_day(&mut self) -> Option<f64> {
        let hour = self.number(2, 0..=23)?;
        let minute = self.next_two(b':', 0..=59)?;
        let second = self.next_two(b':', 0..=60)?;
        let fraction = if self.skip(b".") { self.fraction()? } else { 0.0 };
        Some(f64::from(60 * hour + minute) + (f64::from(second) + fraction) / 60.0)
    }

    /// The digits after a decimal point, at least one.
    fn fraction(&mut self) -> Option<f64> {
        let count = self.rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
        let (digits, rest) = self.rest.split_at(count);
        self.rest = rest;
        let value = |digit: &u8| f64::from(digit - b'0');
        (count > 0).then(|| digits.iter().rev().fold(0.0, |sum, digit| (sum + value(digit)) / 10.0))
    }

    /// `Z` or `±hh:mm` in minutes, at the text's end.
    fn offset(&mut self) -> Option<f64> {
        let offset = if self.skip(b"Zz") {
            0.0
        } else {
            let is_west = self.rest.first() == Some(&b'-');
            if !self.skip(b"+-") {
                return None;
            }
            let hour = self.number(2, 0..=23)?;
            let minutes = f64::from(60 * hour + self.next_two(b':', 0..=59)?);
            if is_west { -minutes } else { minutes }
        };
        self.rest.is_empty().then_some(offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn day_of(time: &str) -> f64 {
        julian_day(time).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Julian days of Meeus, ch. 7 (table on p. 62) and examples 12.a, 12.b and 25.a.
    #[test]
    fn julian_days_agree_with_meeus() {
        assert_eq!(day_of("2000-01-01T12:00:00Z"), 2_451_545.0);
        assert_eq!(day_of("1999-01-01T00:00:00Z"), 2_451_179.5);
        assert_eq!(day_of("1988-06-19T12:00:00Z"), 2_447_332.0);
        assert_eq!(day_of("1600-12-31T00:00:00Z"), 2_305_812.5);
        assert_eq!(day_of("1987-04-10T00:00:00Z"), 2_446_895.5);
        assert!((day_of("1987-04-10T19:21:00Z") - 2_446_896.306_25).abs() < 1e-8);
        assert_eq!(day_of("1992-10-13T00:00:00Z"), 2_448_908.5);
    }

    #[test]
    fn offsets_and_fractions_count() {
        let utc = day_of("2026-06-21T12:00:00Z");
        assert_eq!(day_of("2026-06-21T14:00:00+02:00"), utc);
        assert_eq!(day_of("2026-06-21T08:30:00-03:30"), utc);
        assert_eq!(day_of("2026-06-22t01:00:00.000+13:00"), utc);
        assert_eq!(day_of("2026-06-21T11:59:60z"), utc);
        let later = day_of("2026-06-21T12:00:07.5Z") - utc;
        assert!((later * 86_400.0 - 7.5).abs() < 1e-3);
        assert!(day_of("2024-02-29T00:00:00Z") < day_of("2024-03-01T00:00:00Z"));
    }

    #[test]
    fn reads_place_and_time() {
        let read: PlaceAndTime = " -33.9, 151.2 ,2026-06-21T12:00:00Z".parse().expect("is valid");
        assert_eq!((read.latitude, read.longitude), (-33.9, 151.2));
        assert_eq!(read.julian_day, 2_461_213.0);
    }

    /// Every wrong part is named, and what is expected is said.
    #[test]
    fn errors_name_the_wrong_part() {
        let cases = [
            ("", "three parts"),
            ("1,2", "three parts"),
            ("1,2,2026-06-21T12:00:00Z,4", "three parts"),
            ("91,2,2026-06-21T12:00:00Z", "latitude"),
            ("NaN,2,2026-06-21T12:00:00Z", "latitude"),
            ("1,inf,2026-06-21T12:00:00Z", "longitude"),
            ("1,-180.5,2026-06-21T12:00:00Z", "longitude"),
            ("1,2,", "date"),
            ("1,2,26-06-21T12:00:00Z", "date"),
            ("1,2,2026-02-29T12:00:00Z", "date"),
            ("1,2,2026-13-01T12:00:00Z", "date"),
            ("1,2,2026-06-21", "no T"),
            ("1,2,2026-06-21T24:00:00Z", "time of day"),
            ("1,2,2026-06-21T12:00Z", "time of day"),
            ("1,2,2026-06-21T12:00:00.Z", "time of day"),
            ("1,2,2026-06-21T12:00:00", "offset"),
            ("1,2,2026-06-21T12:00:00+2:00", "offset"),
            ("1,2,2026-06-21T12:00:00+02:00h", "offset"),
            ("1,2,２０２６-06-21T12:00:00Z", "date"),
        ];
        for (text, part) in cases {
            let error = text.parse::<PlaceAndTime>().expect_err(text);
            assert!(error.contains(part) && error.contains("expected"), "{text}: {error}");
        }
        let long = format!("1,2,{}", "9".repeat(100_000));
        assert!(long.parse::<PlaceAndTime>().expect_err("no date").len() < 400);
    }
}
