//! Checks the locations of agents: for example, a sensor for rooms cannot work in a corridor.

use std::collections::{BTreeMap, BTreeSet};

use pddl::{Diagnostic, Name, Span, TypeExpr, Types};

use super::Reviewer;
use crate::hosting;

/// Number of places with agents of a wrong kind up to which the agents count as wrong. If there are
/// more, the map is wrong.
const AGENTS_WRONG_MAX: usize = 2;

/// An agent at a place of the wrong type: the path of its entry, the place, the type of the place,
/// and the type that the agent needs.
type WrongPlace = (String, String, String, String);

impl Reviewer<'_> {
    /// Warns about an agent's location if no predicate can state that the agent is there.
    ///
    /// The predicate by which an agent states its place is not known here. Therefore all predicates
    /// of the ontology between an object of the agent's type and a place are examined. At least one
    /// of them must admit the location.
    pub(super) fn rooms(&mut self) {
        let (ontology, map) = (&self.ecosystem.domain, &self.ecosystem.problem);
        let types = Types::of(ontology);
        let is_a = |expr: &TypeExpr, sort: &Name| {
            expr.alternatives.iter().any(|ty| types.is_subtype(ty.as_str(), sort.as_str()))
        };
        let admits = |wanted: &TypeExpr, given: &TypeExpr| {
            wanted.alternatives.is_empty()
                || wanted.alternatives.iter().any(|sort| is_a(given, sort))
        };
        let way = ontology.predicates.iter().find(|each| each.name == "connected");
        let Some(place) = way.and_then(|way| way.parameters.first()) else { return };
        let models = hosting::models(self.ecosystem);
        let mut wrong = Vec::new();
        for entry in &self.ecosystem.agents {
            let location = entry.config.get("location").and_then(serde_json::Value::as_str);
            let (Some(location), Some(model)) = (location, models.get(&entry.name)) else {
                continue;
            };
            // A button stops others by its heartbeats, wherever it is.
            if self.ecosystem.hardware_stops.contains_key(&entry.name) {
                continue;
            }
            let declared = map.objects.iter().map(|declaration| &declaration.object);
            let Some(place_type) = declared.clone().find(|object| object.name == location) else {
                continue;
            };
            let own = model.objects.iter().map(|declaration| &declaration.object);
            let Some(agent) = own.clone().find(|object| object.name == entry.name.as_str()) else {
                continue;
            };
            let places = ontology.predicates.iter().filter_map(|each| match &each.parameters[..] {
                // The second parameter must be a place, not for example a carrier.
                // A word that is for everything, such as `installed`, tells nothing of the agent.
                [who, place_of] if !who.ty.is_object() => {
                    let is_place = place_of.ty.alternatives.iter().any(|ty| is_a(&place.ty, ty))
                        || admits(&place.ty, &place_of.ty);
                    (is_place && admits(&who.ty, &agent.ty)).then_some(place_of)
                }
                _ => None,
            });
            let places: Vec<_> = places.collect();
            if !places.is_empty() && !places.iter().any(|each| admits(&each.ty, &place_type.ty)) {
                let wanted = places.iter().flat_map(|each| &each.ty.alternatives).next();
                let wanted = wanted.map_or("room", Name::as_str).to_owned();
                let is = place_type.ty.alternatives.first().map_or("object", Name::as_str);
                let (path, location) = (entry.path.clone(), location.to_owned());
                wrong.push((path, location, is.to_owned(), wanted));
            }
        }
        let wrong = self.wrong_in_map(wrong);
        for (path, location, is, wanted) in wrong {
            let is = if is == "outdoors" { is } else { format!("a {is}") };
            let message = format!("`{location}` is {is}, and this agent works in a {wanted}");
            let declaration = match self.ecosystem.is_map_of_tables() {
                true => format!("under [rooms]: {location} = {{ kind = \"{wanted}\" }}"),
                false => format!("on the map: {location} - {wanted}"),
            };
            let help = format!("name a {wanted}, or declare `{location}` as one {declaration}");
            let found = Diagnostic::warning(Span::default(), message).with_help(help);
            self.report_value(&format!("{path}.config.location"), found);
        }
    }

    /// Reports the type of places in the map if agents in many places want another one: then the
    /// map is wrong, and not the agents. Returns the agents that are not explained by that.
    fn wrong_in_map(&mut self, wrong: Vec<WrongPlace>) -> Vec<WrongPlace> {
        let mut places: BTreeMap<(String, String), BTreeSet<String>> = BTreeMap::new();
        for (_, location, is, wanted) in &wrong {
            places.entry((is.clone(), wanted.clone())).or_default().insert(location.clone());
        }
        places.retain(|_, locations| locations.len() > AGENTS_WRONG_MAX);
        for ((is, wanted), locations) in &places {
            let objects = self.ecosystem.problem.objects.iter().map(|it| &it.object);
            let declared = objects.filter(|object| locations.contains(object.name.as_str()));
            let Some(span) = declared.map(|object| object.name.span()).next() else { continue };
            let message = format!(
                "{} places are declared as `{is}`, and the agents there work in a {wanted}",
                locations.len()
            );
            let help = format!("write `- {wanted}` after these places: {}", joined(locations));
            self.report_map(Diagnostic::warning(span, message).with_help(help));
        }
        let is_explained =
            |(_, _, is, wanted): &WrongPlace| places.contains_key(&(is.clone(), wanted.clone()));
        wrong.into_iter().filter(|place| !is_explained(place)).collect()
    }
}

/// Returns the first names of a set, as text.
fn joined(names: &BTreeSet<String>) -> String {
    const SHOWN_MAX: usize = 4;
    let shown: Vec<_> = names.iter().take(SHOWN_MAX).map(String::as_str).collect();
    match names.len().saturating_sub(SHOWN_MAX) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}
