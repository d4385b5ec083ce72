//! The table `[doors]`: the ways between the places of the building, and their lengths.
//!
//! A door stands under one of its two places, and leads both ways unless it says `one-way = true`.

use std::collections::BTreeMap;

use ontology::{PlanDoor, PlanPlace};
use pddl::{Diagnostic, Name};
use serde_json::{Map, Value};

use super::Interpreter;
use crate::config::number_text;
use crate::config::reader::join;

/// Length of a door whose length the file does not say, in meters: a step.
const METERS_ASSUMED: f64 = 1.0;

/// Maximum length of a door, in meters: no building has a longer one, so it is a slip.
const METERS_MAX: f64 = 1_000.0;

/// Maximum number of doors without a length that are reported one by one.
const LENGTHLESS_TOLD_MAX: usize = 3;

/// Maximum number of places that an error message lists.
const PLACES_LISTED_MAX: usize = 12;

/// A door that the file has, before it is compared with the others.
struct WrittenDoor {
    /// The path of the door in the file, such as `doors.corridor.office1`.
    path: String,
    from: String,
    to: String,
    /// The length in meters; `None` if the file does not say it.
    meters: Option<f64>,
    is_one_way: bool,
}

/// The names by which doors can refer to places.
struct KnownPlaces<'p> {
    names: Vec<&'p str>,
    /// The names of places that are refused, and of which nothing more is said.
    refused: &'p [String],
}

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the doors that are correct. Reports the mistakes of the others.
    pub(super) fn doors(
        &mut self,
        doors: &BTreeMap<String, Value>,
        places: &[PlanPlace],
        refused: &[String],
    ) -> Vec<PlanDoor> {
        let names = places.iter().map(|place| place.name.as_str()).collect();
        let known = KnownPlaces { names, refused };
        let mut written = Vec::new();
        for (from, value) in doors {
            let path = join("doors", from);
            if self.is_place(&path, from, &known) {
                self.doors_from(&path, from, value, &known, &mut written);
            }
        }
        // Of two doors, the later one in the file is too many.
        written.sort_by_key(|door: &WrittenDoor| self.span_of_key(&door.path).start);
        self.lengthless(&written);
        let mut kept = self.each_once(written);
        // The map does not depend on the order of the lines in the file.
        kept.sort_by(|one, other| (&one.from, &one.to).cmp(&(&other.from, &other.to)));
        kept.into_iter().map(|door| self.plan_door(door)).collect()
    }

    fn plan_door(&self, door: WrittenDoor) -> PlanDoor {
        let WrittenDoor { path, from, to, meters, is_one_way } = door;
        PlanDoor {
            from: Name::new(&from),
            to: Name::spanned(&to, self.span_of_key(&path)),
            meters: meters.unwrap_or(METERS_ASSUMED),
            is_one_way,
        }
    }

    /// Whether there is a place of this name. Reports a mistake at the key `path` if there is none.
    fn is_place(&mut self, path: &str, name: &str, known: &KnownPlaces<'_>) -> bool {
        if known.names.contains(&name) {
            return true;
        }
        if known.refused.iter().any(|refused| refused == name) {
            return false;
        }
        let message = format!("there is no `{name}` under [rooms], so no door leads there");
        let help = match pddl::nearest(name, known.names.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None if known.names.len() > PLACES_LISTED_MAX => {
                format!("if it is another place, write {name} = {{}} under [rooms]")
            }
            None if known.names.is_empty() => {
                format!("write the places first: [rooms], and below it {name} = {{}}")
            }
            None => format!(
                "[rooms] has {}; if it is another place, write {name} = {{}} there",
                known.names.join(", ")
            ),
        };
        self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
        false
    }

    /// Reads the doors that stand under the place `from`: a table with their lengths, or their names
    /// alone.
    fn doors_from(
        &mut self,
        path: &str,
        from: &str,
        value: &Value,
        known: &KnownPlaces<'_>,
        written: &mut Vec<WrittenDoor>,
    ) {
        let no_keys = Value::Object(Map::new());
        let doors: Vec<(String, &str, &Value)> = match value {
            Value::Object(table) => {
                table.iter().map(|(to, said)| (join(path, to), to.as_str(), said)).collect()
            }
            Value::String(to) => vec![(path.to_owned(), to, &no_keys)],
            Value::Array(list) if list.iter().all(Value::is_string) => {
                let each = list.iter().enumerate();
                each.filter_map(|(index, to)| {
                    Some((join(path, &index.to_string()), to.as_str()?, &no_keys))
                })
                .collect()
            }
            _ => {
                let message =
                    format!("the doors of `{from}` must be a table of places and lengths");
                let help = format!("write {from} = {{ office1 = 4.0 }}");
                self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
                return;
            }
        };
        for (path, to, said) in doors {
            if !self.is_place(&path, to, known) {
                continue;
            }
            if to == from {
                let message = format!("a door leads from `{from}` to itself");
                let help = "name two different places, or take it out";
                self.about_key(&path, |span| Diagnostic::error(span, message).with_help(help));
                continue;
            }
            if let Some((meters, is_one_way)) = self.length_and_way(&path, (from, to), said) {
                let (from, to) = (from.to_owned(), to.to_owned());
                written.push(WrittenDoor { path, from, to, meters, is_one_way });
            }
        }
    }

    /// Returns the length of a door, and whether it leads one way only.
    fn length_and_way(
        &mut self,
        path: &str,
        ends: (&str, &str),
        said: &Value,
    ) -> Option<(Option<f64>, bool)> {
        let Value::Object(keys) = said else {
            let meters = self.meters(path, ends, ends.1, said)?;
            return Some((Some(meters), false));
        };
        let mut meters = None;
        let mut is_one_way = false;
        for (key, value) in keys {
            let inner = join(path, key);
            match (key.as_str(), value) {
                ("length", value) => meters = Some(self.meters(&inner, ends, "length", value)?),
                ("one-way", Value::Bool(said)) => is_one_way = *said,
                ("one-way", _) => {
                    let message = "`one-way` is either true or false";
                    let help = "write one-way = true";
                    self.about_value(&inner, |span| {
                        Diagnostic::error(span, message).with_help(help)
                    });
                    return None;
                }
                (other, _) => {
                    let message = format!("unknown key `{other}` of a door");
                    let help = match pddl::nearest(other, ["length", "one-way"]) {
                        Some(near) => format!("did you mean `{near}`?"),
                        None => "a door has a `length` in meters, and may be `one-way`".to_owned(),
                    };
                    self.about_key(&inner, |span| Diagnostic::error(span, message).with_help(help));
                    return None;
                }
            }
        }
        Some((meters, is_one_way))
    }

    fn meters(
        &mut self,
        path: &str,
        (from, to): (&str, &str),
        key: &str,
        value: &Value,
    ) -> Option<f64> {
        let help = "write how far it is, in meters, more than 0";
        let (message, help) = match value.as_f64() {
            Some(meters) if meters > 0.0 && meters <= METERS_MAX => return Some(meters),
            Some(meters) if meters > METERS_MAX => (
                format!("the door from `{from}` to `{to}` cannot be {meters} m long"),
                format!("write its length in meters, at most {METERS_MAX}"),
            ),
            Some(meters) => (
                format!("the door from `{from}` to `{to}` cannot be {meters} m long"),
                help.to_owned(),
            ),
            None => {
                let written = value.as_str().unwrap_or_default();
                let corrected = number_text::correction(key, written, false);
                (
                    format!("the length of the door from `{from}` to `{to}` must be a number"),
                    corrected.unwrap_or_else(|| format!("{help}: {key} = 4.0")),
                )
            }
        };
        self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
        None
    }

    /// Says of the doors without a length which length is assumed.
    fn lengthless(&mut self, doors: &[WrittenDoor]) {
        let without: Vec<&WrittenDoor> =
            doors.iter().filter(|door| door.meters.is_none()).collect();
        let (told, many) = match without.len() {
            count if count > LENGTHLESS_TOLD_MAX => (&without[..1], Some(count)),
            _ => (&without[..], None),
        };
        for WrittenDoor { path, from, to, .. } in told {
            let message = match many {
                Some(count) => format!(
                    "{count} doors have no length, this is the first: {METERS_ASSUMED} m each is \
                     assumed"
                ),
                None => format!(
                    "the door from `{from}` to `{to}` has no length: {METERS_ASSUMED} m is assumed"
                ),
            };
            let help = format!("write how far it is, in meters: {from} = {{ {to} = 4.0 }}");
            self.about_key(path, |span| Diagnostic::warning(span, message).with_help(help));
        }
    }

    /// Returns each door once, and reports those that stand in the file twice.
    fn each_once(&mut self, doors: Vec<WrittenDoor>) -> Vec<WrittenDoor> {
        let mut kept: Vec<WrittenDoor> = Vec::new();
        let mut ways: BTreeMap<(String, String), usize> = BTreeMap::new();
        for door in doors {
            let forth = (door.from.clone(), door.to.clone());
            let back = (door.to.clone(), door.from.clone());
            let other = ways.get(&forth).or(if door.is_one_way { None } else { ways.get(&back) });
            if let Some(other) = other.and_then(|index| kept.get(*index)) {
                self.door_twice(&door, other.path.clone(), other.meters);
                continue;
            }
            if !door.is_one_way {
                ways.insert(back, kept.len());
            }
            ways.insert(forth, kept.len());
            kept.push(door);
        }
        kept
    }

    fn door_twice(&mut self, door: &WrittenDoor, first: String, first_meters: Option<f64>) {
        let WrittenDoor { path, from, to, meters, is_one_way } = door;
        let first = self.place(&first).map(|(_, place)| place.key);
        let help = "take one of the two out: a door leads both ways; where the way back is another \
                    one, write one-way = true in both";
        let message = format!("the door between `{from}` and `{to}` is there already");
        let is_same = *meters == first_meters && !is_one_way;
        self.about_key(path, |span| {
            let found = match is_same {
                true => Diagnostic::warning(span, message),
                false => Diagnostic::error(span, message),
            };
            let found = found.with_help(help);
            match first {
                Some(first) => found.with_note(first, "the first"),
                None => found,
            }
        });
    }
}
