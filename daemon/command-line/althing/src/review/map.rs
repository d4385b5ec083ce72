//! Checks the map: one-way connections, connections without a length, and places that robots cannot
//! reach.
//!
//! Connections are the facts with the predicate `connected`, and their lengths are the values of
//! the function `distance`: robots move by these two. If an author intends a one-way connection, or
//! a place without connections, a comment in the line (`; one way` or `; no way`) prevents the
//! warning.
//!
//! In a map that is made from `[rooms]` and `[doors]`, each door has a length, and its author says
//! whether it leads one way. Such a map may only have places that cannot be reached; the comment is
//! `# no way` in the line of the place.

use std::collections::{BTreeMap, BTreeSet};

use pddl::{Diagnostic, InitElement, Name, Span, Term, Types};

use super::Reviewer;

/// The predicate of a connection between two places.
const WAY: &str = "connected";
/// The function with the lengths of connections as its values.
const LENGTH: &str = "distance";

/// The comments that mark an intended one-way connection (`ONE_WAY`), and a place that need not be
/// reached (`NO_WAY`).
const ONE_WAY: &[&str] = &["one way", "one-way"];
const NO_WAY: &[&str] = &["no way", "one way", "one-way"];

/// The connections of the map and their lengths.
struct MapConnections<'m> {
    /// Start, end and span of each connection, in the order of the map, without duplicates.
    ways: Vec<(&'m Name, &'m Name, Span)>,
    lengths: BTreeMap<(&'m str, &'m str), (f64, Span)>,
}

impl Reviewer<'_> {
    /// Warns about probable mistakes in the map.
    pub(super) fn map(&mut self) {
        let ways = MapConnections::of(&self.ecosystem.problem.init);
        if self.ecosystem.is_map_of_tables() {
            if self.knows_robots() && (!ways.ways.is_empty() || !self.starts().is_empty()) {
                self.unreachable(&ways);
            }
            return;
        }
        self.impossible_lengths(&ways);
        if self.knows_predicate() && !ways.ways.is_empty() {
            self.one_way(&ways);
            self.without_length(&ways);
            if self.knows_robots() {
                self.unreachable(&ways);
            }
        }
    }

    /// Whether all entries of agents are right: a wrong one may be that of the robot that reaches a
    /// place, or of the door that leads there.
    fn knows_robots(&self) -> bool {
        self.is_complete && !self.report.has_errors()
    }

    fn knows_predicate(&self) -> bool {
        let predicates = &self.ecosystem.domain.predicates;
        predicates.iter().any(|each| each.name == WAY && each.parameters.len() == 2)
    }

    fn knows_lengths(&self) -> bool {
        let functions = &self.ecosystem.domain.functions;
        functions.iter().any(|each| each.name == LENGTH && each.parameters.len() == 2)
    }

    fn impossible_lengths(&mut self, ways: &MapConnections<'_>) {
        for ((from, to), (meters, span)) in &ways.lengths {
            if *meters <= 0.0 {
                let message = format!("the way from `{from}` to `{to}` cannot be {meters} m long");
                let help = "write its length in meters, more than 0";
                self.report_map(Diagnostic::error(*span, message).with_help(help));
            }
        }
        for (from, _, span) in ways.ways.iter().filter(|(from, to, _)| from == to) {
            let message = format!("a way leads from `{from}` to itself");
            let help = "name two different places, or take it out";
            self.report_map(Diagnostic::error(*span, message).with_help(help));
        }
    }

    /// Warns about connections without a way back. There is no warning if other one-way connections
    /// lead back, because such a round trip is intended, for example through an airlock.
    fn one_way(&mut self, ways: &MapConnections<'_>) {
        let given: BTreeSet<_> = ways.pairs().collect();
        let has_back = |(from, to): &(&str, &str)| given.contains(&(*to, *from));
        let (all, two_way) = (graph(ways.pairs()), graph(ways.pairs().filter(has_back)));
        let is_round = |from: &str, to: &str| {
            reached(&all, [to].into_iter()).contains(from)
                && !reached(&two_way, [to].into_iter()).contains(from)
        };
        let is_alone = |(from, to, span): &&(&Name, &Name, Span)| {
            let (from, to) = (from.as_str(), to.as_str());
            from != to
                && !has_back(&(from, to))
                && !is_round(from, to)
                && !self.is_commented(*span, ONE_WAY)
        };
        let alone: Vec<_> = ways.ways.iter().filter(is_alone).collect();
        let Some((first_from, first_to, first)) = alone.first().copied() else { return };
        // If most connections have no way back, one warning for all of them is enough.
        if alone.len() > 2 && alone.len() * 2 > ways.ways.len() {
            let (few, all) = (alone.len(), ways.ways.len());
            let message =
                format!("{few} of {all} ways lead in one direction only; this is the first");
            let help = format!(
                "write the way back too: ({WAY} {first_to} {first_from}); if one way is intended, \
                 write `; one way` in its line"
            );
            return self.report_map(Diagnostic::warning(*first, message).with_help(help));
        }
        for (from, to, span) in alone {
            let message = format!("a way leads from `{from}` to `{to}`, and none back");
            let length = match ways.lengths.get(&(to.as_str(), from.as_str())) {
                Some(_) => String::new(),
                None => ways
                    .lengths
                    .get(&(from.as_str(), to.as_str()))
                    .map_or_else(String::new, |(meters, _)| {
                        format!(" (= ({LENGTH} {to} {from}) {meters})")
                    }),
            };
            let help = format!(
                "write ({WAY} {to} {from}){length} too; if one way is intended, write `; one way` after it"
            );
            self.report_map(Diagnostic::warning(*span, message).with_help(help));
        }
    }

    /// Warns about connections without a length: a robot needs the length to move.
    fn without_length(&mut self, ways: &MapConnections<'_>) {
        if !self.knows_lengths() {
            return;
        }
        let lacks = |(from, to, _): &&(&Name, &Name, Span)| {
            from != to && !ways.lengths.contains_key(&(from.as_str(), to.as_str()))
        };
        let without: Vec<_> = ways.ways.iter().filter(lacks).collect();
        let Some((from, to, span)) = without.first().copied() else { return };
        if without.len() > 2 && without.len() == ways.ways.len() {
            let message = "no way has a length, so no robot can move";
            let help = format!("write how far it is, in meters: (= ({LENGTH} {from} {to}) 5)");
            return self.report_map(Diagnostic::warning(*span, message).with_help(help));
        }
        for (from, to, span) in without {
            let message =
                format!("the way from `{from}` to `{to}` has no length, so no robot takes it");
            let back = ways.lengths.get(&(to.as_str(), from.as_str()));
            let meters = back.map_or(5.0, |(meters, _)| *meters);
            let help =
                format!("write how far it is, in meters: (= ({LENGTH} {from} {to}) {meters})");
            self.report_map(Diagnostic::warning(*span, message).with_help(help));
        }
    }

    /// Warns about places that cannot be reached from a place where a robot starts. If the file has
    /// no robots, warns about places without any connection.
    fn unreachable(&mut self, ways: &MapConnections<'_>) {
        let (poses, doors, starts) = (self.poses(), self.doors_with_agents(), self.starts());
        let mut next: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
        let mut lead = |from, to| {
            next.entry(from).or_default().insert(to);
        };
        for (from, to, span) in &ways.ways {
            lead(from.as_str(), to.as_str());
            // A missing way back is reported already, so here the connection counts in both
            // directions.
            if !self.ecosystem.is_map_of_tables() && !self.is_commented(*span, ONE_WAY) {
                lead(to.as_str(), from.as_str());
            }
        }
        for (one, other) in poses.iter().chain(&doors) {
            lead(one.as_str(), other.as_str());
            lead(other.as_str(), one.as_str());
        }
        let has_robots = !starts.is_empty();
        let reached: BTreeSet<&str> = match has_robots {
            true => reached(&next, starts.iter().map(String::as_str)),
            false => ways.pairs().map(|(_, to)| to).collect(),
        };
        let hub = next.iter().max_by_key(|(name, to)| (reached.contains(*name), to.len()));
        let hub = hub.map_or("corridor", |(name, _)| *name);
        let places = self.places();
        for (name, span) in places.iter().filter(|(name, _)| !reached.contains(name.as_str())) {
            if self.is_commented(*span, NO_WAY) || name.as_str() == hub {
                continue;
            }
            let (message, help) = match self.ecosystem.is_map_of_tables() {
                true => unreachable_by_door(name, hub, has_robots),
                false => unreachable_by_way(name, hub, has_robots),
            };
            self.report_map(Diagnostic::warning(*span, message).with_help(help));
        }
    }

    /// Returns the places of the map, the objects that a connection can have as its start or end:
    /// the name of each, and its span in the text.
    fn places(&self) -> Vec<(Name, Span)> {
        let types = Types::of(&self.ecosystem.domain);
        let predicates = &self.ecosystem.domain.predicates;
        let way = predicates.iter().find(|each| each.name == WAY);
        let sorts: Vec<&Name> =
            way.iter().flat_map(|way| &way.parameters).flat_map(|p| &p.ty.alternatives).collect();
        let is_place = |ty: &Name| {
            sorts.is_empty()
                || sorts.iter().any(|sort| types.is_subtype(ty.as_str(), sort.as_str()))
        };
        let objects = self.ecosystem.problem.objects.iter().map(|declaration| &declaration.object);
        objects
            .filter(|object| object.ty.alternatives.iter().any(is_place))
            .map(|object| (object.name.clone(), object.name.span()))
            .collect()
    }

    /// Returns the names of the places where the robots of the ecosystem file start.
    fn starts(&self) -> Vec<String> {
        let start = |value: &serde_json::Value| Some(value.get("start")?.as_str()?.to_lowercase());
        self.ecosystem.agents.iter().filter_map(|entry| start(&entry.config)).collect()
    }

    /// Returns the names of the poses in the entries of robots, each with the place near which the
    /// pose is.
    fn poses(&self) -> Vec<(String, String)> {
        let mut all = Vec::new();
        for entry in &self.ecosystem.agents {
            let poses = entry.config.get("poses").and_then(serde_json::Value::as_object);
            for (name, pose) in poses.into_iter().flatten() {
                let near = pose.as_str().or_else(|| pose.get("near")?.as_str());
                all.extend(near.map(|near| (name.clone(), near.to_owned())));
            }
        }
        all
    }

    /// Returns the two places of each door that is an agent: the agent itself tells when they are
    /// connected.
    fn doors_with_agents(&self) -> Vec<(String, String)> {
        let places = |value: &serde_json::Value| {
            let [one, other] = value.get("between")?.as_array()?.as_slice() else { return None };
            Some((one.as_str()?.to_lowercase(), other.as_str()?.to_lowercase()))
        };
        self.ecosystem.agents.iter().filter_map(|entry| places(&entry.config)).collect()
    }

    /// Whether a comment in the line of `span` contains one of the texts in `words`.
    fn is_commented(&self, span: Span, words: &[&str]) -> bool {
        let text = &self.ecosystem.sources.map.text;
        let rest = text.get(span.start as usize..).unwrap_or_default();
        let line = rest.lines().next().unwrap_or_default();
        let mark = if self.ecosystem.is_map_of_tables() { '#' } else { ';' };
        let comment = line.split_once(mark).map(|(_, comment)| comment.to_lowercase());
        comment.is_some_and(|comment| words.iter().any(|word| comment.contains(word)))
    }
}

impl<'m> MapConnections<'m> {
    fn of(init: &'m [InitElement]) -> MapConnections<'m> {
        let mut ways = MapConnections { ways: Vec::new(), lengths: BTreeMap::new() };
        let mut seen = BTreeSet::new();
        for element in init {
            match element {
                InitElement::Atom(atom) if atom.predicate == WAY => {
                    if let [Term::Object(from), Term::Object(to)] = atom.arguments.as_slice()
                        && seen.insert((from, to))
                    {
                        ways.ways.push((from, to, atom.span));
                    }
                }
                InitElement::Assign(fluent, number) if fluent.function == LENGTH => {
                    if let [Term::Object(from), Term::Object(to)] = fluent.arguments.as_slice() {
                        let between = (from.as_str(), to.as_str());
                        ways.lengths.insert(between, (number.0, fluent.span));
                    }
                }
                _ => (),
            }
        }
        ways
    }

    fn pairs(&self) -> impl Iterator<Item = (&'m str, &'m str)> {
        self.ways.iter().map(|(from, to, _)| (from.as_str(), to.as_str()))
    }
}

/// Returns the warning about a place that cannot be reached, and its help, in the words of a map in
/// PDDL. `hub` is a place that can be reached.
fn unreachable_by_way(name: &Name, hub: &str, has_robots: bool) -> (String, String) {
    let message = match has_robots {
        true => format!("no robot can reach `{name}`: no way leads there from its start"),
        false => format!("no way leads to `{name}`"),
    };
    let help = format!(
        "write, under (:init, ({WAY} {hub} {name}) (= ({LENGTH} {hub} {name}) 5), and the \
         same back; if that is intended, write `; no way` in the line of its name"
    );
    (message, help)
}

/// Returns the same as [`unreachable_by_way`], in the words of `[rooms]` and `[doors]`.
fn unreachable_by_door(name: &Name, hub: &str, has_robots: bool) -> (String, String) {
    let message = match has_robots {
        true => format!("no robot can reach `{name}`: no door leads there from its start"),
        false => format!("no door leads to `{name}`"),
    };
    let help = format!(
        "write its door under [doors], such as {hub} = {{ {name} = 4.0 }}; if that is intended, \
         write `# no way` in the line of `{name}` under [rooms]"
    );
    (message, help)
}

/// Returns, for each place, the places to which a connection leads from it.
fn graph<'n>(
    ways: impl Iterator<Item = (&'n str, &'n str)>,
) -> BTreeMap<&'n str, BTreeSet<&'n str>> {
    let mut next: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for (from, to) in ways {
        next.entry(from).or_default().insert(to);
    }
    next
}

/// Returns all places that can be reached from the places in `starts`, which are included.
fn reached<'n>(
    next: &BTreeMap<&'n str, BTreeSet<&'n str>>,
    starts: impl Iterator<Item = &'n str>,
) -> BTreeSet<&'n str> {
    let mut waiting: Vec<&str> = starts.collect();
    let mut reached = BTreeSet::new();
    while let Some(place) = waiting.pop() {
        if reached.insert(place) {
            waiting.extend(next.get(place).into_iter().flatten());
        }
    }
    reached
}
