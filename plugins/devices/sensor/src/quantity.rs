//! The quantities that these sensors measure. A new quantity needs a line in the table here, and
//! its names in the shared ontology; to be simulated, it also needs a line in the crate `building`.

use actuator::{is_derived, is_possible_value};
use pddl::Domain;

/// A quantity that a sensor measures in its room.
///
/// The PDDL names follow from the name of the quantity. For example, `co2` is measured by a
/// `co2-sensor`. The sensor's action `report-co2` runs the method `read_co2` and makes `(known-co2
/// ROOM)` true.
#[derive(Debug)]
pub(crate) struct SensorQuantity {
    pub(crate) name: &'static str,
    pub(crate) value: ValueForm,
}

/// The form of a quantity's value in the ontology, and as a text for people.
#[derive(Debug)]
pub(crate) enum ValueForm {
    /// A number: `(= (FUNCTION ROOM) 21.5)` in PDDL. `unit` is the unit of the number; `words` is
    /// the text after the number in texts for people.
    Number { function: &'static str, unit: &'static str, words: &'static str, decimals: usize },
    /// A yes or no: `(PREDICATE ROOM)` or its negation. The sensor reports changes by itself.
    YesOrNo {
        predicate: &'static str,
        /// Two predicates of the sensor itself: one for its value and one for its room. They are
        /// used if the ontology derives the predicate of the room from them: for example, a room is
        /// closed if all its doors and windows are closed.
        own: Option<(&'static str, &'static str)>,
        yes: &'static str,
        no: &'static str,
    },
}

/// The table of all quantities.
pub(crate) const QUANTITIES: &[SensorQuantity] = &[
    number("temperature", "temperature", ("°C", "°C"), 1),
    number("humidity", "humidity", ("%", "% humidity"), 0),
    number("co2", "co2", ("ppm", "ppm of CO2"), 0),
    number("light", "light", ("lx", "lx"), 0),
    number("distance", "free-distance", ("m", "m of free distance"), 2),
    yes_or_no("motion", "motion", "motion", "no motion"),
    yes_or_no("reflection", "reflection", "something close by", "nothing close by"),
    SensorQuantity {
        name: "contact",
        value: ValueForm::YesOrNo {
            predicate: "closed",
            own: Some(("shut", "contact-at")),
            yes: "closed",
            no: "open",
        },
    },
];

const fn number(
    name: &'static str,
    function: &'static str,
    (unit, words): (&'static str, &'static str),
    decimals: usize,
) -> SensorQuantity {
    SensorQuantity { name, value: ValueForm::Number { function, unit, words, decimals } }
}

const fn yes_or_no(
    name: &'static str,
    predicate: &'static str,
    yes: &'static str,
    no: &'static str,
) -> SensorQuantity {
    SensorQuantity { name, value: ValueForm::YesOrNo { predicate, own: None, yes, no } }
}

impl SensorQuantity {
    /// Returns the quantity of this name. If there is none, returns an error with the most similar
    /// name or all known names.
    pub(crate) fn named(name: &str) -> Result<&'static SensorQuantity, String> {
        let names = || QUANTITIES.iter().map(|quantity| quantity.name);
        QUANTITIES.iter().find(|quantity| quantity.name == name).ok_or_else(|| match pddl::nearest(
            name,
            names(),
        ) {
            Some(nearest) => format!("unknown quantity `{name}`; did you mean `{nearest}`?"),
            None => {
                let known: Vec<_> = names().collect();
                format!("unknown quantity `{name}`; known are {}", known.join(", "))
            }
        })
    }

    /// Returns the unit of the quantity; empty for a yes-or-no quantity.
    pub(crate) fn unit(&self) -> &'static str {
        match self.value {
            ValueForm::Number { unit, .. } => unit,
            ValueForm::YesOrNo { .. } => "",
        }
    }

    /// Returns `value` if it is possible for the quantity; otherwise an error with the reason.
    pub(crate) fn possible(&self, value: f64) -> Result<f64, String> {
        let is_possible = is_possible_value(value, self.unit());
        // The value of a yes-or-no quantity is 1 or 0, or the strength of a signal.
        if is_possible && (!self.is_noticed() || value >= 0.0) {
            return Ok(value);
        }
        // Very large numbers are shown with an exponent, because hundreds of digits are hard to
        // read.
        let told = if value.abs() < 1e9 { value.to_string() } else { format!("{value:e}") };
        Err(match self.unit() {
            "" => format!("{told}, which is impossible"),
            unit => format!("{told}, which is impossible in {unit}"),
        })
    }

    /// Returns the PDDL type of a sensor with this quantity as its first.
    pub(crate) fn sensor_type(&self) -> String {
        format!("{}-sensor", self.name)
    }

    /// Returns the name of the action that reports the quantity.
    pub(crate) fn action(&self) -> String {
        format!("report-{}", self.name)
    }

    /// Returns the name of the method that performs the action.
    pub(crate) fn method(&self) -> String {
        format!("read_{}", self.name)
    }

    /// Returns the name of the predicate which states that the quantity is known.
    pub(crate) fn known(&self) -> String {
        format!("known-{}", self.name)
    }

    /// Whether a sensor reports changes of the quantity by itself.
    pub(crate) fn is_noticed(&self) -> bool {
        matches!(self.value, ValueForm::YesOrNo { .. })
    }

    /// Returns the PDDL term for the quantity's value: a function or a predicate.
    pub(crate) fn term(&self, sensor: &str, room: &str, ontology: &Domain) -> String {
        match self.value {
            ValueForm::Number { function, .. } => format!("({function} {room})"),
            ValueForm::YesOrNo { predicate, own: Some((own, _)), .. }
                if is_derived(ontology, predicate) =>
            {
                format!("({own} {sensor})")
            }
            ValueForm::YesOrNo { predicate, .. } => format!("({predicate} {room})"),
        }
    }

    /// Returns an additional PDDL fact about the sensor's room that the quantity needs; empty for
    /// most quantities.
    pub(crate) fn place(&self, sensor: &str, room: &str, ontology: &Domain) -> String {
        match self.value {
            ValueForm::YesOrNo { predicate, own: Some((_, at)), .. }
                if is_derived(ontology, predicate) =>
            {
                format!("({at} {sensor} {room})")
            }
            _ => String::new(),
        }
    }

    /// Returns a value as PDDL facts. `term` is the quantity's term in PDDL.
    pub(crate) fn facts(&self, term: &str, room: &str, value: f64) -> String {
        let known = self.known();
        match self.value {
            ValueForm::Number { .. } => format!("({known} {room}) (= {term} {value})"),
            ValueForm::YesOrNo { .. } if is_yes(value) => format!("({known} {room}) {term}"),
            ValueForm::YesOrNo { .. } => format!("({known} {room}) (not {term})"),
        }
    }

    /// Returns the PDDL facts which state that the value is unknown.
    pub(crate) fn unknown(&self, term: &str, room: &str) -> String {
        let known = self.known();
        match self.value {
            ValueForm::Number { .. } => format!("(not ({known} {room}))"),
            ValueForm::YesOrNo { .. } => format!("(not ({known} {room})) (unknown {term})"),
        }
    }

    /// Formats a value for people, with its unit or in words.
    pub(crate) fn words(&self, value: f64) -> String {
        match self.value {
            ValueForm::Number { words, decimals, .. } => format!("{value:.decimals$} {words}"),
            ValueForm::YesOrNo { yes, .. } if is_yes(value) => yes.to_owned(),
            ValueForm::YesOrNo { no, .. } => no.to_owned(),
        }
    }
}

/// Whether a value means yes: drivers return 1 or 0, and a value of one half or more counts as yes.
pub(crate) fn is_yes(value: f64) -> bool {
    value >= 0.5
}
