//! Explanations as English sentences.

use std::fmt;

use pddl::{Name, Term};

use super::{
    Alternative, Explanation, MissingCapability, Obstacle, Placement, RequiredPlace, SupposedObject,
};

/// Maximum number of similar items that a list names; the further ones are only counted.
const NAMED_MAX: usize = 3;

impl fmt::Display for Explanation {
    /// Writes one sentence, without a period, for each group of conjuncts that lack the same
    /// capabilities.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut sentences: Vec<(String, Vec<String>, String)> = Vec::new();
        for obstacle in &self.obstacles {
            let (lead, subject, rest) = obstacle.sentence();
            let same =
                |known: &&mut (String, Vec<String>, String)| known.0 == lead && known.2 == rest;
            match sentences.iter_mut().find(same) {
                Some((_, subjects, _)) => subjects.push(subject),
                None => sentences.push((lead, vec![subject], rest)),
            }
        }
        if sentences.is_empty() {
            f.write_str(match (self.is_complete, self.parts) {
                (false, _) => "what is missing was not found within the bounds of the search",
                (true, 0 | 1) => {
                    "it can be reached if no step undoes anything; the steps towards it interfere"
                }
                (true, _) => "each part can be reached alone; together they interfere",
            })?;
        }
        for (number, (lead, subjects, rest)) in sentences.iter().enumerate() {
            let separator = if number == 0 { "" } else { ". Also, " };
            write!(f, "{separator}{lead}{}; {rest}", named(subjects))?;
        }
        Ok(())
    }
}

// === impl Obstacle ===

impl Obstacle {
    /// Explains in one sentence why this conjunct of the goal cannot be reached. Returns the three
    /// parts of the sentence: its beginning, its subject (the conjunct), and its end (the
    /// capabilities that would suffice). Sentences with equal beginnings and equal ends can be
    /// joined.
    fn sentence(&self) -> (String, String, String) {
        let there = self.there();
        let nobody = match self.agents {
            0 | 1 => "no agent".to_owned(),
            2 => "no two agents".to_owned(),
            several => format!("no {several} agents"),
        };
        let (lead, subject) = match (self.actions.as_slice(), self.unreachable.as_slice()) {
            ([action], [atom]) => match atom.arguments.as_slice() {
                [place] if self.is_place(&there) => {
                    (format!("{nobody} can `{action}` at "), format!("`{}`", text(place)))
                }
                [thing] => (format!("{nobody} can `{action}` for "), format!("`{}`", text(thing))),
                _ => (format!("{nobody} can `{action}` for "), format!("`{atom}`")),
            },
            _ => ("no agent here can reach ".to_owned(), format!("`{}`", self.conjunct)),
        };
        (lead, subject, self.rest(&there))
    }

    fn rest(&self, there: &[&Name]) -> String {
        if self.is_numeric {
            return "an action would do, but a numeric condition prevents it".to_owned();
        }
        if !self.hindrances.is_empty() {
            let facts: Vec<String> =
                self.hindrances.iter().map(|fact| format!("`{fact}`")).collect();
            let verb = if facts.len() == 1 { "prevents" } else { "prevent" };
            return format!("{} {verb} it, which no agent here ends", named(&facts));
        }
        let is_here =
            |missing: &MissingCapability| matches!(missing.agent, SupposedObject::Here(_));
        let (here, new): (Vec<&Alternative>, Vec<&Alternative>) =
            self.alternatives.iter().partition(|one| one.missing.iter().all(is_here));
        let here = here.iter().map(|alternative| {
            let silent =
                alternative.missing.chunk_by(|one, two| one.agent == two.agent).map(|own| {
                    let actions: Vec<String> =
                        own.iter().map(|missing| format!("`{}`", missing.action)).collect();
                    format!("{} does not offer {}", own[0].agent, actions.join(" and "))
                });
            format!("{} now", silent.collect::<Vec<_>>().join(" and "))
        });
        let mut clauses: Vec<String> = here.collect();
        if !new.is_empty() {
            let known = match self.actions.as_slice() {
                [action] => Some(action),
                _ => None,
            };
            let words = |alternative: &&Alternative| {
                let words = alternative.words(known, there);
                match (self.agents, alternative.missing.as_slice()) {
                    // The other agents of the joint action are there.
                    (2.., [one]) => words.replacen(&one.agent.to_string(), &one.agent.another(), 1),
                    _ => words,
                }
            };
            let new: Vec<String> = new.iter().map(words).collect();
            let comma = if new.len() > 1 { "," } else { "" };
            clauses.push(format!("{}{comma} would do", new.join(", or ")));
        }
        match clauses.is_empty() {
            false => clauses.join("; "),
            true if self.actions.is_empty() => {
                "no agent that is or was here has an action for it".to_owned()
            }
            true => "it needs more than two conditions that no agent makes true".to_owned(),
        }
    }

    /// Returns the objects in the unreachable facts of this conjunct.
    fn there(&self) -> Vec<&Name> {
        let terms = self.unreachable.iter().flat_map(|atom| &atom.arguments);
        terms.map(text).collect()
    }

    /// Whether a new agent would have to be at one of the objects in `there`, which are the objects
    /// of this conjunct.
    fn is_place(&self, there: &[&Name]) -> bool {
        let missing = self.alternatives.iter().flat_map(|alternative| &alternative.missing);
        missing.flat_map(|missing| &missing.places).any(|placement| placement.is_there(there))
    }
}

// === impl Alternative ===

impl Alternative {
    /// Describes the alternative in words. `known` is the action that the sentence has already
    /// named; it is not named again. `there` has the objects of the conjunct; a place among them is
    /// called “there”.
    fn words(&self, known: Option<&Name>, there: &[&Name]) -> String {
        let mut missing: Vec<&MissingCapability> = self.missing.iter().collect();
        missing.sort_by_key(|missing| known != Some(&missing.action));
        match missing.as_slice() {
            [one, other] if one.is_placed_on(other) => one.words(known, there).replacen(
                &other.agent.to_string(),
                &other.words(known, there),
                1,
            ),
            all => {
                let all: Vec<String> =
                    all.iter().map(|missing| missing.words(known, there)).collect();
                match all.as_slice() {
                    [one, other] if one == other => format!("{one} and another one"),
                    all => all.join(" and "),
                }
            }
        }
    }
}

// === impl MissingCapability ===

impl MissingCapability {
    fn words(&self, known: Option<&Name>, there: &[&Name]) -> String {
        let MissingCapability { action, agent, places } = self;
        if let SupposedObject::Here(_) = agent {
            return format!("{agent}, which does not offer `{action}` now");
        }
        let mut words = agent.to_string();
        if known != Some(action) {
            words += &format!(" that can `{action}`");
        }
        let mut placed: Vec<String> = Vec::new();
        for placement in places {
            let place = placement.words(there);
            if !placed.contains(&place) {
                words += &place;
                placed.push(place);
            }
        }
        words
    }

    /// Whether this capability's agent must be placed on the new agent of `other`.
    fn is_placed_on(&self, other: &MissingCapability) -> bool {
        let is_other = |place: &Vec<SupposedObject>| *place == [other.agent.clone()];
        matches!(other.agent, SupposedObject::New(_))
            && self.places.iter().any(|placement| match &placement.place {
                RequiredPlace::At(places) => !placement.is_reversed && places.iter().all(is_other),
                RequiredPlace::Anywhere => false,
            })
    }
}

// === impl Placement ===

impl Placement {
    fn is_there(&self, there: &[&Name]) -> bool {
        let RequiredPlace::At(places) = &self.place else { return false };
        if self.is_reversed {
            return false;
        }
        let [place] = places.as_slice() else { return false };
        matches!(place.as_slice(), [SupposedObject::Here(object)] if there.contains(&object))
    }

    fn words(&self, there: &[&Name]) -> String {
        let RequiredPlace::At(places) = &self.place else { return String::new() };
        if self.is_there(there) {
            return " there".to_owned();
        }
        let place = |place: &Vec<SupposedObject>| {
            place.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
        };
        let mut places: Vec<String> = places.iter().map(place).collect();
        places.dedup();
        let rest = places.len().saturating_sub(NAMED_MAX);
        places.truncate(NAMED_MAX);
        let more = if rest > 0 { format!(" or {rest} more") } else { String::new() };
        let (predicate, places) =
            (self.predicate.spelled().replace('-', " "), format!("{}{more}", places.join(" or ")));
        if self.is_reversed {
            return format!(", with {places} {predicate} it");
        }
        format!(" {predicate} {places}")
    }
}

impl fmt::Display for SupposedObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SupposedObject::Here(object) => write!(f, "`{object}`"),
            SupposedObject::New(ty) => {
                let kinds: Vec<String> =
                    ty.alternatives.iter().map(|kind| kind.spelled().replace('-', " ")).collect();
                let kind = if kinds.is_empty() { "agent".to_owned() } else { kinds.join(" or ") };
                let is_vowel = kind.starts_with(['a', 'e', 'i', 'o', 'u']);
                write!(f, "{} {kind}", if is_vowel { "an" } else { "a" })
            }
        }
    }
}

impl SupposedObject {
    /// Returns the object in words; a new agent as one beside others that are there.
    fn another(&self) -> String {
        match self {
            SupposedObject::Here(_) => self.to_string(),
            SupposedObject::New(_) => {
                let words = self.to_string();
                let kind = words.split_once(' ').map_or(words.as_str(), |(_, kind)| kind);
                format!("another {kind}")
            }
        }
    }
}

fn text(term: &Term) -> &Name {
    match term {
        Term::Object(name) | Term::Variable(name) => name,
    }
}

/// Joins names to a text such as “`a`, `b`, `c` and 4 more”.
fn named(things: &[String]) -> String {
    let (first, rest) = things.split_at(things.len().min(NAMED_MAX));
    match (first, rest) {
        ([.., _], [_, ..]) => format!("{} and {} more", first.join(", "), rest.len()),
        ([most @ .., last], []) if !most.is_empty() => {
            format!("{} and {last}", most.join(", "))
        }
        _ => first.concat(),
    }
}
