//! The reasons why a text cannot be changed as asked.

/// Reason why something cannot be added to the text of an ecosystem file. The text is a sentence
/// for the author of the file, without a full stop.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// The text is not valid TOML.
    #[error("line {line} is not valid TOML: {message}")]
    Toml {
        /// Number of the line, from 1.
        line: usize,
        /// Message of the parser.
        message: String,
    },
    /// A name is not possible.
    #[error("`{name}` cannot be the name of {what}: {rule}{}", suggested(suggestion.as_deref()))]
    Name {
        /// The name that was asked for.
        name: String,
        /// Kind of the thing, with its article.
        what: &'static str,
        /// Rule for names.
        rule: &'static str,
        /// Name that is possible.
        suggestion: Option<String>,
    },
    /// A name is taken.
    #[error("there is {what} `{name}` already, in line {line}; nothing is added")]
    Taken {
        /// Kind of the thing that has the name, with its article.
        what: &'static str,
        /// The name.
        name: String,
        /// Number of the line, from 1.
        line: usize,
    },
    /// A place is not in the file.
    #[error("there is no room `{name}`{}", known_rooms(nearest.as_deref(), known))]
    UnknownRoom {
        /// The name that was asked for.
        name: String,
        /// The most similar name of a room.
        nearest: Option<String>,
        /// All names of rooms.
        known: Vec<String>,
    },
    /// A door leads from a place to itself.
    #[error("a door leads from one room to another, and `{0}` is on both of its sides")]
    DoorToItself(String),
    /// A length, an area or a floor is impossible.
    #[error("{what} of {value} is impossible: {rule}")]
    Number {
        /// The quantity, with its article.
        what: &'static str,
        /// The number.
        value: String,
        /// Rule for the quantity.
        rule: &'static str,
    },
    /// A setting cannot be read.
    #[error("`{text}` is no setting: {rule}")]
    Setting {
        /// The text that was given.
        text: String,
        /// What a setting looks like.
        rule: &'static str,
    },
    /// A setting is given twice.
    #[error("`{0}` is given twice")]
    Twice(String),
    /// The file has a map in PDDL, to which this crate adds nothing.
    #[error(
        "this file has a map of its own, in PDDL ({0}): add the {1} there, or replace `domain` and \
         `problem` by the tables [rooms] and [doors]"
    )]
    OwnMap(String, &'static str),
    /// A part of the file is written in a form to which nothing can be added.
    #[error("`{part}` in line {line} is {form}; write {instead} by hand")]
    Form {
        /// Path of the part.
        part: String,
        /// Number of the line, from 1.
        line: usize,
        /// Form of the part.
        form: &'static str,
        /// Form to which something can be added.
        instead: &'static str,
    },
    /// The changed text is not valid.
    #[error("the text could not be added in a valid way ({0}); nothing is changed")]
    Broken(String),
    /// The check of the whole text refuses what was added; the text is that of the check.
    #[error("{0}")]
    Refused(String),
    /// A sensor has no device, and is not to be simulated.
    #[error(
        "say which device measures the {quantity} in `{place}`: {quantity}@{place}=DEVICE, where \
         `althing sensors` lists the devices of this machine; or say --simulated, to try it without"
    )]
    NoDevice {
        /// Quantity that is to be measured.
        quantity: String,
        /// Room of the sensor.
        place: String,
    },
    /// A robot cannot carry a sensor of a quantity.
    #[error(
        "a robot carries a thermometer only, so write temperature@{robot}; {quantity} is measured \
             in rooms"
    )]
    Carried {
        /// Quantity that is to be measured.
        quantity: String,
        /// Name of the robot.
        robot: String,
    },
    /// A word of the command line cannot be read.
    #[error("`{word}` is no {what}: write {form}{}", suggested(suggestion.as_deref()))]
    Word {
        /// The word that was given.
        word: String,
        /// Kind of the word.
        what: &'static str,
        /// What such a word looks like.
        form: &'static str,
        /// Word that was probably meant.
        suggestion: Option<String>,
    },
}

fn suggested(name: Option<&str>) -> String {
    name.map(|name| format!("; did you mean `{name}`?")).unwrap_or_default()
}

fn known_rooms(nearest: Option<&str>, known: &[String]) -> String {
    match (nearest, known) {
        (Some(_), _) => suggested(nearest),
        (None, []) => "; the file has none yet: `althing add room NAME` adds one".to_owned(),
        (None, known) => format!("; there are {}", known.join(", ")),
    }
}
