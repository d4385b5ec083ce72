//! Checks the locations of agents: for example, a sensor for rooms cannot work in a corridor.

use pddl::{Diagnostic, Name, Span, TypeExpr, Types};

use super::Reviewer;
use crate::hosting;

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
                [who, place_of] if !who.ty.alternatives.is_empty() => {
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
                wrong.push((entry.path.clone(), location.to_owned(), is.to_owned(), wanted));
            }
        }
        for (path, location, is, wanted) in wrong {
            let message = format!("`{location}` is a {is}, and this agent works in a {wanted}");
            let help = format!(
                "name a {wanted}, or declare `{location}` as one on the map: {location} - {wanted}"
            );
            let found = Diagnostic::warning(Span::default(), message).with_help(help);
            self.report_value(&format!("{path}.config.location"), found);
        }
    }
}
