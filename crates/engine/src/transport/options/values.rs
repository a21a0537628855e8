//! What a setting can be set to: numbers in a range, switches, words that stand for something.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

/// The values of a setting: how a text reads as one, and what they look like from outside.
pub trait Values: Sync {
    /// What a method gets to see.
    type Value;

    /// The value that `text` stands for; `None` where it stands for none.
    fn read(&self, text: &str) -> Option<Self::Value>;

    /// What they look like.
    fn form(&self) -> Form;
}

/// What values look like, for documents, forms and error messages.
#[derive(Clone, Debug, PartialEq)]
pub struct Form {
    /// The numbers or switches among them.
    pub kind: Kind,
    /// The words among them.
    pub words: Vec<&'static str>,
}

/// Values that are no words of their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Whole numbers.
    Whole {
        /// The least.
        low: u64,
        /// The greatest.
        high: u64,
        /// Whether they must be even.
        even: bool,
    },
    /// Numbers.
    Number {
        /// The least.
        low: f64,
        /// The greatest.
        high: f64,
    },
    /// True and false.
    Switch,
    /// None: there are words only.
    Words,
}

impl Display for Form {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let words: Vec<_> = self.words.iter().map(|word| format!("{word:?}")).collect();
        match self.kind {
            Kind::Words => {
                let (last, others) = words.split_last().expect("there is a choice");
                return write!(f, "{} or {last}", others.join(", "));
            }
            Kind::Switch => write!(f, "true or false")?,
            Kind::Number { low, high } => write!(f, "a number from {low} to {high}")?,
            Kind::Whole { low, high, even } => {
                let what = if even { "an even whole number" } else { "a whole number" };
                write!(f, "{what} from {low} to {high}")?;
            }
        }
        words.iter().try_for_each(|word| write!(f, ", or {word}"))
    }
}

/// Whole numbers in a range.
pub struct Whole {
    /// The least.
    pub low: u64,
    /// The greatest.
    pub high: u64,
}

impl Values for Whole {
    type Value = u64;

    fn read(&self, text: &str) -> Option<u64> {
        within(text, self.low, self.high)
    }

    fn form(&self) -> Form {
        let kind = Kind::Whole { low: self.low, high: self.high, even: false };
        Form { kind, words: Vec::new() }
    }
}

/// Even whole numbers in a range.
pub struct Even {
    /// The least.
    pub low: u64,
    /// The greatest.
    pub high: u64,
}

impl Values for Even {
    type Value = u64;

    fn read(&self, text: &str) -> Option<u64> {
        within(text, self.low, self.high).filter(|number: &u64| number.is_multiple_of(2))
    }

    fn form(&self) -> Form {
        let kind = Kind::Whole { low: self.low, high: self.high, even: true };
        Form { kind, words: Vec::new() }
    }
}

/// Whole numbers in a range, and words beside them.
pub struct WholeOr<T: 'static> {
    /// The least.
    pub low: u64,
    /// The greatest.
    pub high: u64,
    /// What a number stands for.
    pub number: fn(u64) -> T,
    /// What the words stand for.
    pub words: &'static [(&'static str, T)],
}

impl<T: Copy + Sync> Values for WholeOr<T> {
    type Value = T;

    fn read(&self, text: &str) -> Option<T> {
        word(self.words, text).or_else(|| within(text, self.low, self.high).map(self.number))
    }

    fn form(&self) -> Form {
        let kind = Kind::Whole { low: self.low, high: self.high, even: false };
        Form { kind, words: self.words.iter().map(|(word, _)| *word).collect() }
    }
}

/// Numbers in a range.
pub struct Number {
    /// The least.
    pub low: f64,
    /// The greatest.
    pub high: f64,
}

impl Values for Number {
    type Value = f64;

    fn read(&self, text: &str) -> Option<f64> {
        within(text, self.low, self.high)
    }

    fn form(&self) -> Form {
        Form { kind: Kind::Number { low: self.low, high: self.high }, words: Vec::new() }
    }
}

/// True and false, and the other words for them.
pub struct Switch;

impl Values for Switch {
    type Value = bool;

    fn read(&self, text: &str) -> Option<bool> {
        match text {
            "true" | "on" | "yes" | "1" => Some(true),
            "false" | "off" | "no" | "0" => Some(false),
            _ => None,
        }
    }

    fn form(&self) -> Form {
        Form { kind: Kind::Switch, words: Vec::new() }
    }
}

/// Words that stand for something.
pub struct Choice<T: 'static>(pub &'static [(&'static str, T)]);

impl<T: Copy + Sync> Values for Choice<T> {
    type Value = T;

    fn read(&self, text: &str) -> Option<T> {
        word(self.0, text)
    }

    fn form(&self) -> Form {
        Form { kind: Kind::Words, words: self.0.iter().map(|(word, _)| *word).collect() }
    }
}

fn word<T: Copy>(words: &[(&str, T)], text: &str) -> Option<T> {
    words.iter().find(|(word, _)| *word == text).map(|(_, meaning)| *meaning)
}

/// NaN is in no range.
fn within<T: FromStr + PartialOrd>(text: &str, low: T, high: T) -> Option<T> {
    text.parse().ok().filter(|number| (low..=high).contains(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_read_as_values_within_their_range() {
        let whole = Whole { low: 4, high: 64 };
        assert_eq!((whole.read("4"), whole.read("64")), (Some(4), Some(64)));
        for text in ["3", "65", "-4", "4.5", "many", "", " 4"] {
            assert_eq!(whole.read(text), None, "{text:?}");
        }
        let even = Even { low: 8, high: 2048 };
        assert_eq!((even.read("8"), even.read("9"), even.read("2050")), (Some(8), None, None));
        let number = Number { low: 0.0, high: 1.0 };
        assert_eq!(
            (number.read("0.25"), number.read("NaN"), number.read("inf")),
            (Some(0.25), None, None)
        );
        let either = WholeOr { low: 1, high: 9, number: Some, words: &[("auto", None)] };
        assert_eq!((either.read("auto"), either.read("7")), (Some(None), Some(Some(7))));
        assert_eq!((either.read("10"), either.read("Auto")), (None, None));
        assert_eq!(
            (Switch.read("on"), Switch.read("0"), Switch.read("2")),
            (Some(true), Some(false), None)
        );
        let choice = Choice(&[("one", 1), ("two", 2)]);
        assert_eq!((choice.read("two"), choice.read("three")), (Some(2), None));
    }

    #[test]
    fn forms_say_what_is_allowed() {
        let said = |form: Form| form.to_string();
        assert_eq!(said(Whole { low: 1, high: 9 }.form()), "a whole number from 1 to 9");
        assert_eq!(said(Even { low: 2, high: 8 }.form()), "an even whole number from 2 to 8");
        assert_eq!(said(Number { low: 0.0, high: 1.5 }.form()), "a number from 0 to 1.5");
        assert_eq!(said(Switch.form()), "true or false");
        assert_eq!(said(Choice(&[("a", ()), ("b", ())]).form()), "\"a\" or \"b\"");
        let either = WholeOr { low: 1, high: 9, number: Some, words: &[("auto", None)] };
        assert_eq!(said(either.form()), "a whole number from 1 to 9, or \"auto\"");
    }
}
