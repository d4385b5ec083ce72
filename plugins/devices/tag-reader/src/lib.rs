//! A reader of the tags of parcels and tables: it tells the ecosystem which there are, and where each of
//! them is. It has no actions; robots carry them.
//!
//! The reader has one driver, `simulated`.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use building::{BuildingHandle, ParcelPlace};
use serde::Deserialize;
use tokio::sync::watch;

/// The entry of the tag reader in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "tag-reader",
    about: "tells which parcels and tables there are, and where they are",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

/// Interval between two readings of all tags.
const READ_INTERVAL: Duration = Duration::from_millis(50);

/// How long a tag must have been read in its new place before the reader tells. A robot that has just
/// moved the parcel confirms within this time, so that plans learn it from the robot first.
const SETTLED: Duration = Duration::from_millis(100);

/// The `config` of a tag reader's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// The parcels with tags, by their names. In a simulated building each of them lies in this
    /// place at the start.
    #[serde(default)]
    parcels: BTreeMap<String, PlaceName>,
    /// The tables with tags, in the same way.
    #[serde(default)]
    tables: BTreeMap<String, PlaceName>,
}

struct TagReader {
    id: String,
    ontology: String,
    /// Names of the parcels with tags.
    parcels: Vec<PlaceName>,
    /// Names of the tables with tags.
    tables: Vec<PlaceName>,
    building: Arc<BuildingHandle>,
    /// Where each parcel was at the last reading; `None` if the tags cannot be read.
    places: Arc<watch::Sender<Option<BTreeMap<String, ParcelPlace>>>>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { parcels, tables } = blueprint.config_as()?;
    let names = |key: &str, things: BTreeMap<String, PlaceName>| {
        let names = things.into_keys().map(PlaceName::try_from).collect::<Result<Vec<_>, _>>();
        names.map_err(|error| blueprint.problem(format!("{key}: {error}")))
    };
    let (parcels, tables) = (names("parcels", parcels)?, names("tables", tables)?);
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let reader = TagReader {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        parcels,
        tables,
        building,
        places: Arc::new(watch::Sender::new(None)),
    };
    Actuator::build(&blueprint, reader)
}

impl Device for TagReader {
    type Yield = ();

    fn describe(&self) -> Description {
        let TagReader { id, ontology, .. } = self;
        let objects = |names: &[PlaceName], ty: &str| match names {
            [] => String::new(),
            names => {
                let names: Vec<String> = names.iter().map(ToString::to_string).collect();
                format!("{} - {ty}", names.join(" "))
            }
        };
        let (parcels, tables) = (objects(&self.parcels, "parcel"), objects(&self.tables, "table"));
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types tag-reader lift-cabin - agent item - object parcel table - item)
                (:predicates (parcel-at ?p - parcel ?l - location)
                    (in-cabin ?p - parcel ?c - lift-cabin)
                    (table-at ?t - table ?l - location))
                (:objects {id} - tag-reader {parcels} {tables}))"
        );
        Description { model: model_of(&text), methods: [].into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let places = self.places.borrow().clone().unwrap_or_default();
        let is_one_of =
            |names: &[PlaceName], thing: &str| names.iter().any(|own| own.as_str() == thing);
        let known = places
            .iter()
            .filter(|(thing, _)| is_one_of(&self.parcels, thing) || is_one_of(&self.tables, thing));
        let fact = |(parcel, place): (&String, &ParcelPlace)| match place {
            ParcelPlace::At(location) if is_one_of(&self.tables, parcel) => {
                format!(" (table-at {parcel} {location})")
            }
            ParcelPlace::At(location) => format!(" (parcel-at {parcel} {location})"),
            ParcelPlace::In(lift) => format!(" (in-cabin {parcel} {lift})"),
            ParcelPlace::On(_) | ParcelPlace::Stored { .. } => String::new(),
        };
        facts_of(&known.map(fact).collect::<String>())
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let places = Arc::clone(&self.places);
        Some(Box::pin(async move {
            let read = building.read_tags(&id).await.ok();
            places.send_replace(read);
        }))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        let unknown = MethodFailure::UnknownMethod(call.method.clone());
        Box::pin(std::future::ready(Err(unknown)))
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        MethodResult::default()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<TagReader>>> {
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let places = Arc::clone(&self.places);
        Some(Box::pin(async move {
            loop {
                tokio::time::sleep(READ_INTERVAL).await;
                let read = building.read_tags(&id).await.ok();
                if *places.borrow() == read {
                    continue;
                }
                tokio::time::sleep(SETTLED).await;
                if building.read_tags(&id).await.ok() == read {
                    let news: DeviceEvent<TagReader> = Box::new(move |reader| {
                        reader.places.send_replace(read);
                        Vec::new()
                    });
                    return news;
                }
            }
        }))
    }

    fn makes_bids(&self) -> bool {
        false
    }
}
