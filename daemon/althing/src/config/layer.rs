//! One layer of the configuration: values that match the schema, and the place where each was
//! written.
//!
//! The `config` crate merges layers; this module keeps the places, so that mistakes that are found
//! later still point into the text of the file or the environment.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::config::{ConfigError, Map, Source as ConfigSource, Value};
use pddl::Span;
use terminal::report::SourceText;

/// The place where a value was written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct KeyValueSpan {
    /// The key; for an element of a list, the element.
    pub(crate) key: Span,
    /// The value.
    pub(crate) value: Span,
}

/// The place of every key, for mistakes that are found later.
#[derive(Clone, Debug, Default)]
pub(crate) struct SourceMap(BTreeMap<String, (Arc<SourceText>, KeyValueSpan)>);

impl SourceMap {
    /// Collects the places of layers. The last layer has precedence.
    pub(super) fn of(layers: &[Layer]) -> SourceMap {
        let places = layers.iter().flat_map(|layer| {
            let place = |(path, place): (&String, &KeyValueSpan)| {
                (path.clone(), (Arc::clone(&layer.source), *place))
            };
            layer.places.iter().map(place)
        });
        SourceMap(places.collect())
    }

    /// Returns the values written directly under a path, as they stand in the text.
    pub(crate) fn under(&self, path: &str) -> Vec<&str> {
        let is_under = |key: &str| {
            let rest = key.strip_prefix(path).and_then(|rest| rest.strip_prefix('.'));
            rest.is_some_and(|rest| !rest.contains('.'))
        };
        let found = self.0.iter().filter(|(key, _)| is_under(key));
        found.filter_map(|(_, (source, place))| source.text.get(place.value.range())).collect()
    }

    /// Returns the place of a path, or else of the nearest thing around it; the flag is `true` if
    /// it is the path itself.
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

/// Checked values and their places.
#[derive(Clone, Debug)]
pub(super) struct Layer {
    /// The text in which they are written.
    pub(super) source: Arc<SourceText>,
    /// By dotted path: `agent.0.name`.
    pub(super) places: BTreeMap<String, KeyValueSpan>,
    /// The values that the `config` crate merges.
    pub(super) values: Map<String, Value>,
    /// Whether all of the text could be parsed.
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
