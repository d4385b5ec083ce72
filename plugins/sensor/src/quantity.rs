//! The quantities that these sensors measure. To add one, add its line here, its names to the shared
//! ontology, and, to simulate it, its line in the building.

use actuator::is_derived;
use pddl::Domain;

/// A quantity that a sensor measures in its room.
///
/// The PDDL names follow from its name: `co2` is measured by a `co2-sensor`. The sensor's action
/// `report-co2` runs the method `read_co2` and makes `(known-co2 ROOM)` true.
#[derive(Debug)]
pub(crate) struct SensorQuantity {
    pub(crate) name: &'static str,
    pub(crate) value: ValueForm,
}

/// The form of a quantity's value, in the ontology and for people.
#[derive(Debug)]
pub(crate) enum ValueForm {
    /// A number: `(= (FUNCTION ROOM) 21.5)`; for people with a unit.
    Number { function: &'static str, unit: &'static str, decimals: usize },
    /// Yes or no: `(PREDICATE ROOM)` or its negation. The sensor reports changes by itself.
    YesOrNo {
        predicate: &'static str,
        /// The predicates of the sensor itself for its value and its room, used if the ontology derives the
        /// predicate of the room from them: a room is closed if all its doors and windows are.
        own: Option<(&'static str, &'static str)>,
        yes: &'static str,
        no: &'static str,
    },
}

/// All quantities.
pub(crate) const QUANTITIES: &[SensorQuantity] = &[
    number("temperature", "temperature", "°C", 1),
    number("humidity", "humidity", "% humidity", 0),
    number("co2", "co2", "ppm of CO2", 0),
    number("light", "light", "lx", 0),
    number("distance", "free-distance", "m of free distance", 2),
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
    unit: &'static str,
    decimals: usize,
) -> SensorQuantity {
    SensorQuantity { name, value: ValueForm::Number { function, unit, decimals } }
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
    /// Returns the quantity of this name. Returns an error with the known or the most similar names if
    /// there is none.
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

    /// Returns the type of a sensor with this as its first quantity.
    pub(crate) fn sensor_type(&self) -> String {
        format!("{}-sensor", self.name)
    }

    /// The action that reports it.
    pub(crate) fn action(&self) -> String {
        format!("report-{}", self.name)
    }

    /// The method that performs the action.
    pub(crate) fn method(&self) -> String {
        format!("read_{}", self.name)
    }

    /// The predicate that it is known.
    pub(crate) fn known(&self) -> String {
        format!("known-{}", self.name)
    }

    /// Whether a sensor reports changes by itself.
    pub(crate) fn is_noticed(&self) -> bool {
        matches!(self.value, ValueForm::YesOrNo { .. })
    }

    /// Returns the PDDL term of the quantity, for a sensor in a room: a function or a predicate.
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

    /// Returns the PDDL fact for the sensor's room that it needs besides `located`; empty for most
    /// quantities.
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

    /// Returns a value as PDDL facts; `term` is the quantity's term in PDDL.
    pub(crate) fn facts(&self, term: &str, room: &str, value: f64) -> String {
        let known = self.known();
        match self.value {
            ValueForm::Number { .. } => format!("({known} {room}) (= {term} {value})"),
            ValueForm::YesOrNo { .. } if is_yes(value) => format!("({known} {room}) {term}"),
            ValueForm::YesOrNo { .. } => format!("({known} {room}) (not {term})"),
        }
    }

    /// Returns the PDDL facts for an unknown value.
    pub(crate) fn unknown(&self, term: &str, room: &str) -> String {
        let known = self.known();
        match self.value {
            ValueForm::Number { .. } => format!("(not ({known} {room}))"),
            ValueForm::YesOrNo { .. } => format!("(not ({known} {room})) (unknown {term})"),
        }
    }

    /// Returns a value as a text for people.
    pub(crate) fn words(&self, value: f64) -> String {
        match self.value {
            ValueForm::Number { unit, decimals, .. } => format!("{value:.decimals$} {unit}"),
            ValueForm::YesOrNo { yes, .. } if is_yes(value) => yes.to_owned(),
            ValueForm::YesOrNo { no, .. } => no.to_owned(),
        }
    }
}

/// Whether a value means yes: drivers return 1 or 0, and one half or more counts as yes.
pub(crate) fn is_yes(value: f64) -> bool {
    value >= 0.5
}
