//! One layer of the configuration: values that match the schema, and the place where each value was
//! written.
//!
//! The `config` crate merges the layers. This module keeps the places of the values, so that a
//! mistake that is found after merging can still be shown in the text of the file or the
//! environment.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::config::{ConfigError, Map, Source as ConfigSource, Value};
use pddl::Span;
use terminal::report::SourceText;

/// The place in a text where a key and its value are written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct KeyValueSpan {
    /// The span of the key; for an element of a list, the span of the element.
    pub(crate) key: Span,
    /// The span of the value.
    pub(crate) value: Span,
}

/// The place of every key, by the path of the key, for mistakes that are found after merging.
#[derive(Clone, Debug, Default)]
pub(crate) struct SourceMap(BTreeMap<String, (Arc<SourceText>, KeyValueSpan)>);

impl SourceMap {
    /// Collects the places of the values of all layers. If several layers set a key, the last one
    /// counts.
    pub(super) fn of(layers: &[Layer]) -> SourceMap {
        let places = layers.iter().flat_map(|layer| {
            let place = |(path, place): (&String, &KeyValueSpan)| {
                (path.clone(), (Arc::clone(&layer.source), *place))
            };
            layer.places.iter().map(place)
        });
        SourceMap(places.collect())
    }

    /// Returns the values of the keys that stand directly below `path`, as they are written in the
    /// text.
    pub(crate) fn under(&self, path: &str) -> Vec<&str> {
        let is_under = |key: &str| {
            let rest = key.strip_prefix(path).and_then(|rest| rest.strip_prefix('.'));
            rest.is_some_and(|rest| !rest.contains('.'))
        };
        let found = self.0.iter().filter(|(key, _)| is_under(key));
        found.filter_map(|(_, (source, place))| source.text.get(place.value.range())).collect()
    }

    /// Returns the names of the keys that stand directly below `path`.
    pub(crate) fn keys_under(&self, path: &str) -> impl Iterator<Item = &str> {
        let below = format!("{path}.");
        let under = self.0.keys().filter_map(move |key| key.strip_prefix(&below));
        under.filter(|key| !key.contains('.'))
    }

    /// Returns the names of all agents of the file. Entries with mistakes count, too.
    pub(crate) fn names_of_agents(&self) -> impl Iterator<Item = String> {
        let entries = self.0.range("agent.".to_owned()..);
        let entries = entries.take_while(|(key, _)| key.starts_with("agent."));
        let names = entries.filter(|(key, _)| {
            key.strip_suffix(".name").is_some_and(|entry| entry.matches('.').count() == 1)
        });
        let text = |(_, (source, place)): (_, &(Arc<SourceText>, KeyValueSpan))| {
            Some(source.text.get(place.value.range())?.trim_matches(['"', '\'']).to_owned())
        };
        names.filter_map(text)
    }

    /// Returns the places of the keys below `path`, at any depth, each with its text.
    pub(crate) fn within(
        &self,
        path: &str,
    ) -> impl Iterator<Item = (&Arc<SourceText>, &KeyValueSpan)> {
        let below = format!("{path}.");
        let within = self.0.iter().filter(move |(key, _)| key.starts_with(&below));
        within.map(|(_, (source, place))| (source, place))
    }

    /// Returns the place of the key at `path`. If no text sets that key, returns the place of the
    /// nearest table or entry around it. The flag is `true` if the place is that of `path` itself.
    pub(crate) fn find(&self, path: &str) -> Option<(Arc<SourceText>, KeyValueSpan, bool)> {
        let mut around = path;
        loop {
            if let Some((source, place)) = self.0.get(around) {
                return Some((Arc::clone(source), *place, around == path));
            }
            around = around.rsplit_once('.')?.0;
        }
    }
}

/// The values of one layer, which match the schema, and their places.
#[derive(Clone, Debug)]
pub(super) struct Layer {
    /// The text in which the values are written.
    pub(super) source: Arc<SourceText>,
    /// The places of the values, by dotted path, such as `agent.0.name`.
    pub(super) places: BTreeMap<String, KeyValueSpan>,
    /// The values that the `config` crate merges.
    pub(super) values: Map<String, Value>,
    /// Whether the whole text could be parsed.
    pub(super) is_whole: bool,
}

// === impl Layer ===

impl Layer {
    /// Creates a layer without values.
    pub(super) fn new(source: Arc<SourceText>) -> Layer {
        Layer { source, places: BTreeMap::new(), values: Map::new(), is_whole: true }
    }
}

impl ConfigSource for Layer {
    fn clone_into_box(&self) -> Box<dyn ConfigSource + Send + Sync> {
        Box::new(self.clone())
    }

    fn collect(&self) -> Result<Map<String, Value>, ConfigError> {
        Ok(self.values.clone())
    }
}
