//! The table `[rooms]`: the places of the building, their kinds, and what else is said of them.
//!
//! A key of a place, besides `kind` and `floor`, is a word of the ontology: `staff-only = true` is a
//! fact, `used-for = "talks"` a fact with an object, and `area = 12.5` the value of a function.

use std::collections::BTreeMap;

use ontology::{PlanPlace, PlanStatement, floor_name, place_name_problem};
use pddl::{Diagnostic, Domain, Name, Span, TypeExpr, Typed, Types};
use serde_json::{Map, Value};

use super::Interpreter;
use crate::config::reader::join;

/// The type of a place that names no kind.
const ROOM: &str = "room";

/// The type of which every place is.
const LOCATION: &str = "location";

/// The function of a place's square meters.
const AREA: &str = "area";

/// The predicate that the key `floor` stands for.
const ON_FLOOR: &str = "on-floor";

/// Maximum number of kinds or words that an error message lists.
const LISTED_MAX: usize = 16;

/// The words and the names that statements about places can have.
struct PlaceWords<'d> {
    domain: &'d Domain,
    types: Types,
    rooms: &'d BTreeMap<String, Value>,
}

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the places that are correct, and the names of the others. Reports their mistakes.
    pub(super) fn rooms(
        &mut self,
        rooms: &BTreeMap<String, Value>,
        domain: &Domain,
    ) -> (Vec<PlanPlace>, Vec<String>) {
        let words = PlaceWords { domain, types: Types::of(domain), rooms };
        let (mut places, mut refused) = (Vec::new(), Vec::new());
        for (name, value) in rooms {
            let path = join("rooms", name);
            if !self.is_place_name(&path, name) {
                refused.push(name.clone());
                continue;
            }
            places.push(self.room(&path, name, value, &words));
        }
        if rooms.is_empty() {
            self.no_rooms();
        }
        (places, refused)
    }

    fn no_rooms(&mut self) {
        let message = "[rooms] names no place";
        let help = "write them below it, one in a line: office1 = {}";
        let path = if self.place("rooms").is_some() { "rooms" } else { "doors" };
        self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
    }

    /// Whether a place can have the name `name`. Reports a mistake if it cannot.
    fn is_place_name(&mut self, path: &str, name: &str) -> bool {
        let Some((reason, near)) = place_name_problem(name) else { return true };
        let message = format!("`{name}` cannot be the name of a room: {reason}");
        let help = match near {
            Some(near) => format!("write {near} = {{}}, and `{near}` wherever it is named"),
            None => "choose a name of letters from a to z, digits and `-`".to_owned(),
        };
        self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
        false
    }

    fn room(&mut self, path: &str, name: &str, value: &Value, words: &PlaceWords<'_>) -> PlanPlace {
        let nothing = Map::new();
        let (kind, kind_path, keys) = match value {
            Value::Object(keys) => (keys.get("kind"), join(path, "kind"), keys),
            Value::String(_) => (Some(value), path.to_owned(), &nothing),
            _ => {
                let message = format!("what is said of `{name}` must be a table");
                let help = format!("write {name} = {{}}, or {name} = {{ kind = \"corridor\" }}");
                self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
                (None, path.to_owned(), &nothing)
            }
        };
        let kind = self.kind(&kind_path, name, kind, words);
        let statements = keys.iter().filter(|(key, _)| *key != "kind");
        let statements = statements
            .flat_map(|(key, value)| self.statement(&join(path, key), (name, key), value, words));
        let statements = statements.collect();
        PlanPlace { name: Name::spanned(name, self.span_of_key(path)), kind, statements }
    }

    /// Returns the type of a place; that of a room if the file names none, or a wrong one.
    fn kind(
        &mut self,
        path: &str,
        name: &str,
        kind: Option<&Value>,
        words: &PlaceWords<'_>,
    ) -> Name {
        let Some(kind) = kind else { return Name::new(ROOM) };
        let Some(kind) = kind.as_str() else {
            let message = format!("the kind of `{name}` must be a text in quotes");
            let help = "such as kind = \"corridor\"";
            self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
            return Name::new(ROOM);
        };
        if words.kinds().any(|known| known == kind) {
            return Name::new(kind);
        }
        let message = format!("there is no kind of place `{kind}`");
        let help = match pddl::nearest(kind, words.kinds()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!(
                "known are {}; others need a vocabulary (docs/building.md)",
                listed(words.kinds())
            ),
        };
        self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
        Name::new(ROOM)
    }

    /// Returns the statements that the key `key` of the place `name` makes.
    fn statement(
        &mut self,
        path: &str,
        (name, key): (&str, &str),
        value: &Value,
        words: &PlaceWords<'_>,
    ) -> Vec<PlanStatement> {
        let span = self.span_of_key(path);
        if key == "floor" {
            return self.floor(path, name, value, span);
        }
        let is_function =
            words.domain.functions.iter().any(|it| it.name == key && it.parameters.len() == 1);
        if is_function {
            return self.measure(path, (name, key), value, span);
        }
        let predicate = words.domain.predicates.iter().find(|it| it.name == key);
        let objects: Vec<&str> = match value {
            Value::String(object) => vec![object],
            Value::Array(list) => list.iter().filter_map(Value::as_str).collect(),
            _ => Vec::new(),
        };
        match (predicate.map(|it| it.parameters.as_slice()), value) {
            (Some([_]), Value::Bool(true)) => {
                vec![PlanStatement::Holds { predicate: Name::spanned(key, span) }]
            }
            (Some([_]), Value::Bool(false)) => Vec::new(),
            (Some([_, about]), Value::String(_) | Value::Array(_)) if !objects.is_empty() => {
                let mut related = Vec::new();
                for object in objects {
                    if self.is_object_name(path, object)
                        && self.is_known_place(path, object, &about.ty, words)
                    {
                        let name = Name::spanned(object, span);
                        let object = Typed { name, ty: about.ty.clone() };
                        let predicate = Name::spanned(key, span);
                        related.push(PlanStatement::Relates { predicate, object });
                    }
                }
                related
            }
            (Some(parameters), _) => {
                self.wrong_statement(path, (name, key), parameters.len());
                Vec::new()
            }
            (None, _) => {
                self.unknown_word(path, key, words);
                Vec::new()
            }
        }
    }

    fn floor(&mut self, path: &str, name: &str, value: &Value, span: Span) -> Vec<PlanStatement> {
        let floor = match (value.as_i64(), value.as_str()) {
            (Some(number), _) => floor_name(number),
            (None, Some(text)) if text.trim().parse::<i64>().is_ok() => {
                let message = format!(
                    "the number of a floor stands without quotes, and this of `{name}` is a text"
                );
                let help = format!("write floor = {}", text.trim());
                self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
                return Vec::new();
            }
            (None, Some(text)) if self.is_object_name(path, text) => text.to_owned(),
            (None, Some(_)) => return Vec::new(),
            (None, None) => {
                let message = format!("the floor of `{name}` must be a whole number or a name");
                let help = "such as floor = 1 or floor = \"ground\"";
                self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
                return Vec::new();
            }
        };
        let object = Typed { name: Name::spanned(&floor, span), ty: TypeExpr::of("floor") };
        vec![PlanStatement::Relates { predicate: Name::spanned(ON_FLOOR, span), object }]
    }

    fn measure(
        &mut self,
        path: &str,
        (name, key): (&str, &str),
        value: &Value,
        span: Span,
    ) -> Vec<PlanStatement> {
        match value.as_f64().filter(|value| value.is_finite()) {
            Some(value) if key == AREA && value <= 0.0 => {
                let message = format!("`{key}` of `{name}` must be above zero");
                let help = match value < 0.0 {
                    true => format!("write {key} = {}", -value),
                    false => format!("leave it out, or write its square meters: {key} = 12.5"),
                };
                self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
                Vec::new()
            }
            Some(value) => {
                vec![PlanStatement::Measures { function: Name::spanned(key, span), value }]
            }
            None => {
                let message = format!("`{key}` of `{name}` must be a number");
                let written = value.as_str().unwrap_or_default();
                let corrected = crate::config::number_text::correction(key, written, false);
                let help = corrected.unwrap_or_else(|| format!("such as {key} = 12.5"));
                self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
                Vec::new()
            }
        }
    }

    /// Whether a text can be the name of an object that a place is related to.
    fn is_object_name(&mut self, path: &str, name: &str) -> bool {
        let Some((reason, near)) = place_name_problem(name) else { return true };
        let message = format!("`{name}` cannot be a name: {reason}");
        let help = near.map_or_else(
            || "write letters from a to z, digits and `-`".to_owned(),
            |near| format!("write \"{near}\""),
        );
        self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
        false
    }

    /// Whether an object is a place of the file, if it has to be one. Reports a mistake if it is not.
    fn is_known_place(
        &mut self,
        path: &str,
        object: &str,
        expected: &TypeExpr,
        words: &PlaceWords<'_>,
    ) -> bool {
        let is_place = |ty: &Name| words.types.is_subtype(ty.as_str(), LOCATION);
        if !expected.alternatives.iter().any(is_place) || words.rooms.contains_key(object) {
            return true;
        }
        let message = format!("there is no `{object}` under [rooms]");
        let near = pddl::nearest(object, words.rooms.keys().map(String::as_str));
        let help = near.map_or_else(
            || format!("if it is another place, write {object} = {{}} there"),
            |near| format!("did you mean `{near}`?"),
        );
        self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
        false
    }

    fn wrong_statement(&mut self, path: &str, (name, key): (&str, &str), parameters: usize) {
        let (message, help) = match parameters {
            1 => (
                format!("`{key}` of `{name}` is either true or false"),
                format!("write {key} = true"),
            ),
            2 => (
                format!("`{key}` of `{name}` names something else"),
                format!("write its name in quotes, or several in [ ]: {key} = \"NAME\""),
            ),
            _ => (
                format!("`{key}` says nothing of one place alone"),
                "a place can have words about itself, or about itself and one other thing"
                    .to_owned(),
            ),
        };
        self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
    }

    fn unknown_word(&mut self, path: &str, key: &str, words: &PlaceWords<'_>) {
        let message = format!("unknown key `{key}` of a place");
        let help = match pddl::nearest(key, words.keys()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => {
                "known are kind, floor, area and the words of the ontology about places; others \
                 need a vocabulary (docs/building.md)"
                    .to_owned()
            }
        };
        self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
    }

    /// Returns the span of the key at `path` in the ecosystem file; the empty span if the key is not
    /// in the file, but in the environment.
    pub(super) fn span_of_key(&self, path: &str) -> Span {
        let file = self.layers.get(1);
        file.and_then(|file| file.places.get(path)).map_or_else(Span::default, |place| place.key)
    }
}

// === impl PlaceWords ===

impl PlaceWords<'_> {
    /// Returns the names of the types that a place can have.
    fn kinds(&self) -> impl Iterator<Item = &str> {
        self.types.subtypes(LOCATION).map(Name::as_str)
    }

    /// Returns the keys that a place can have, apart from its kind.
    fn keys(&self) -> impl Iterator<Item = &str> {
        let is_about_places = |parameters: &[Typed]| {
            parameters.first().is_some_and(|first| {
                first.ty.is_object()
                    || first.ty.alternatives.iter().any(|ty| {
                        self.types.is_subtype(ty.as_str(), LOCATION)
                            || self.types.is_subtype(LOCATION, ty.as_str())
                    })
            })
        };
        let predicates = self.domain.predicates.iter();
        let predicates = predicates
            .filter(move |it| it.parameters.len() <= 2 && is_about_places(&it.parameters))
            .map(|it| it.name.as_str());
        let functions = self.domain.functions.iter();
        let functions = functions
            .filter(move |it| it.parameters.len() == 1 && is_about_places(&it.parameters))
            .map(|it| it.name.as_str());
        ["kind", "floor"].into_iter().chain(predicates).chain(functions)
    }
}

/// Lists names in a text, at most [`LISTED_MAX`] of them.
fn listed<'n>(names: impl Iterator<Item = &'n str>) -> String {
    let all: Vec<&str> = names.collect();
    let shown = all.iter().take(LISTED_MAX).copied().collect::<Vec<_>>().join(", ");
    match all.len().saturating_sub(LISTED_MAX) {
        0 => shown,
        others => format!("{shown} and {others} others"),
    }
}
