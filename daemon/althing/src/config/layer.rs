//! One layer of the configuration: values that passed the schema, and where each was written.
//!
//! The `config` crate merges layers; this remembers the places, so that whatever is found wrong
//! later still points into the text, be it the file's or the environment's.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::config::{ConfigError, Map, Source as ConfigSource, Value};
use pddl::Span;
use terminal::report::Source;

/// Where something was written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// The key, or of an element the element.
    pub(crate) key: Span,
    /// The value.
    pub(crate) value: Span,
}

/// Where every key was written, for mistakes that are found later.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places(BTreeMap<String, (Arc<Source>, Place)>);

impl Places {
    /// Those of layers, the strongest last.
    pub(super) fn of(layers: &[Layer]) -> Places {
        let places = layers.iter().flat_map(|layer| {
            let place = |(path, place): (&String, &Place)| {
                (path.clone(), (Arc::clone(&layer.source), *place))
            };
            layer.places.iter().map(place)
        });
        Places(places.collect())
    }

    /// The values written directly under a path, as they stand in the text.
    pub(crate) fn under(&self, path: &str) -> Vec<&str> {
        let is_under = |key: &str| {
            let rest = key.strip_prefix(path).and_then(|rest| rest.strip_prefix('.'));
            rest.is_some_and(|rest| !rest.contains('.'))
        };
        let found = self.0.iter().filter(|(key, _)| is_under(key));
        found.filter_map(|(_, (source, place))| source.text.get(place.value.range())).collect()
    }

    /// Where something was written, or else the nearest thing around it; and whether it is that.
    pub(crate) fn find(&self, path: &str) -> Option<(Arc<Source>, Place, bool)> {
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
    /// The text they were written in.
    pub(super) source: Arc<Source>,
    /// By dotted path: `agent.0.name`.
    pub(super) places: BTreeMap<String, Place>,
    /// What `config` merges.
    pub(super) values: Map<String, Value>,
    /// All of the text could be read.
    pub(super) is_whole: bool,
}

// === impl Layer ===

impl Layer {
    /// A layer that says nothing.
    pub(super) fn new(source: Arc<Source>) -> Layer {
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
