//! A reader of the tags of parcels: it tells the ecosystem which parcels there are, and where each of
//! them lies. It has no actions; robots carry the parcels.
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
    about: "tells which parcels there are, and where they lie",
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
    parcels: BTreeMap<String, PlaceName>,
}

struct TagReader {
    id: String,
    ontology: String,
    /// Names of the parcels with tags.
    parcels: Vec<PlaceName>,
    building: Arc<BuildingHandle>,
    /// Where each parcel was at the last reading; `None` if the tags cannot be read.
    places: Arc<watch::Sender<Option<BTreeMap<String, ParcelPlace>>>>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { parcels } = blueprint.config_as()?;
    let parcels = parcels.into_keys().map(PlaceName::try_from);
    let parcels: Vec<PlaceName> = parcels
        .collect::<Result<_, _>>()
        .map_err(|error| blueprint.problem(format!("parcels: {error}")))?;
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let reader = TagReader {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        parcels,
        building,
        places: Arc::new(watch::Sender::new(None)),
    };
    Actuator::build(&blueprint, reader)
}

impl Device for TagReader {
    type Yield = ();

    fn describe(&self) -> Description {
        let TagReader { id, ontology, .. } = self;
        let parcels = self.parcels.iter().map(|parcel| format!(" {parcel}"));
        let parcels = match self.parcels.is_empty() {
            true => String::new(),
            false => format!("{} - parcel", parcels.collect::<String>()),
        };
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types tag-reader lift-cabin - agent item - object parcel - item)
                (:predicates (parcel-at ?p - parcel ?l - location)
                    (in-cabin ?p - parcel ?c - lift-cabin))
                (:objects {id} - tag-reader {parcels}))"
        );
        Description { model: model_of(&text), methods: [].into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let places = self.places.borrow().clone().unwrap_or_default();
        let known = places
            .iter()
            .filter(|(parcel, _)| self.parcels.iter().any(|own| own.as_str() == parcel.as_str()));
        let fact = |(parcel, place): (&String, &ParcelPlace)| match place {
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
