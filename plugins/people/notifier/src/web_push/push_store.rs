//! The subscriptions of browsers, and the key that they hold for, in the state folder. The page adds
//! and removes subscriptions, and the notifier drops those that have ended; a lock keeps each change
//! whole.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use acl::AgentId;
use base64::Engine as _;
use base64::engine::general_purpose::{STANDARD_NO_PAD, URL_SAFE_NO_PAD};
use serde::{Deserialize, Serialize};

use super::encryption::BrowserKeys;
use super::identification::PushIdentity;
use crate::address::ReceiverAddress;

/// Maximum number of subscriptions: a building has a few people with a few browsers each.
const SUBSCRIPTIONS_MAX: usize = 200;

/// Longest address of a subscription, in bytes.
const ENDPOINT_BYTES_MAX: usize = 1_024;

/// Maximum length of a file of the store, in bytes.
const FILE_BYTES_MAX: u64 = 1 << 20;

/// Push services of browsers. A subscription names a place to send to, so that only known ones are
/// taken: no person can make a daemon send requests to other machines of the building.
pub(crate) const KNOWN_SERVICES: [&str; 4] = [
    "https://fcm.googleapis.com",
    "https://*.push.services.mozilla.com",
    "https://*.notify.windows.com",
    "https://*.push.apple.com",
];

/// A subscription to push messages, in the form that browsers give it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PushSubscription {
    /// Address of the push service for this browser; it is a secret of the browser.
    pub endpoint: String,
    /// Keys that the browser has made.
    pub keys: PushKeys,
    /// Name of the person that has subscribed; the page writes it.
    #[serde(default)]
    pub person: String,
}

/// Keys of a subscription, in base64 for addresses.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PushKeys {
    /// Public key of the browser.
    pub p256dh: String,
    /// Secret by which the browser authenticates messages.
    pub auth: String,
}

/// Error of the store. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PushStoreError {
    /// No notifier has prepared the store.
    #[error("find a notifier with web push on this machine")]
    Missing,
    /// A file cannot be read or written.
    #[error("use {}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        #[source]
        source: io::Error,
    },
    /// A file has another content than was written.
    #[error("use {}: {problem}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Description of the mistake.
        problem: String,
    },
    /// A subscription cannot be used.
    #[error("take the subscription: {0}")]
    Subscription(String),
    /// There are too many subscriptions.
    #[error("take the subscription: there are {SUBSCRIPTIONS_MAX} already")]
    Full,
}

/// The subscriptions of one notifier, and its key.
#[derive(Debug)]
pub struct PushStore {
    folder: PathBuf,
    identity: PushIdentity,
    services: Vec<String>,
}

// === impl PushSubscription ===

impl PushSubscription {
    /// Returns the keys. Errors complete “failed to …”.
    pub(crate) fn keys(&self) -> Result<BrowserKeys, String> {
        let wrong = || "use the keys of a subscription: they are none".to_owned();
        let public = decoded(&self.keys.p256dh).ok_or_else(wrong)?;
        let auth = decoded(&self.keys.auth).ok_or_else(wrong)?;
        let public = public.try_into().map_err(|_| wrong())?;
        Ok(BrowserKeys { public, auth: auth.try_into().map_err(|_| wrong())? })
    }
}

/// Decodes either alphabet of base64, with or without padding: browsers differ.
fn decoded(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=');
    URL_SAFE_NO_PAD.decode(text).or_else(|_| STANDARD_NO_PAD.decode(text)).ok()
}

// === impl PushStore ===

impl PushStore {
    /// Returns the folder of a notifier's store.
    pub(crate) fn folder_of(state_folder: &Path, agent: &AgentId) -> PathBuf {
        state_folder.join(format!("{agent}.push"))
    }

    /// Opens the store of the notifier `agent`, which it has prepared on this machine.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such notifier, or its files cannot be read.
    pub fn open(state_folder: &Path, agent: &AgentId) -> Result<PushStore, PushStoreError> {
        let folder = PushStore::folder_of(state_folder, agent);
        let identity = PushStore::identity(&folder)?.ok_or(PushStoreError::Missing)?;
        let services = read_json(&folder.join("services.json"))?.ok_or(PushStoreError::Missing)?;
        Ok(PushStore { folder, identity, services })
    }

    /// Opens a store, and makes it if it is missing.
    pub(crate) fn create(folder: &Path, services: &[String]) -> Result<PushStore, PushStoreError> {
        if let Some(identity) = PushStore::identity(folder)? {
            let store =
                PushStore { folder: folder.to_owned(), identity, services: services.to_owned() };
            let path = folder.join("services.json");
            if read_json::<Vec<String>>(&path)?.as_deref() != Some(services) {
                write_json(&path, &services)?;
            }
            return Ok(store);
        }
        let made = fs::DirBuilder::new().mode(0o700).recursive(true).create(folder);
        made.map_err(|source| PushStoreError::File { path: folder.to_owned(), source })?;
        let guard = lock(folder)?;
        let path = folder.join("key");
        // Another process may have made it a moment ago.
        if PushStore::identity(folder)?.is_none() {
            let malformed = |problem| PushStoreError::Malformed { path: path.clone(), problem };
            let key = PushIdentity::generate().map_err(malformed)?;
            replace(&path, key.as_bytes())?;
        }
        drop(guard);
        PushStore::create(folder, services)
    }

    fn identity(folder: &Path) -> Result<Option<PushIdentity>, PushStoreError> {
        let path = folder.join("key");
        let Some(text) = read(&path)? else { return Ok(None) };
        let identity = PushIdentity::parse(&text);
        identity.map(Some).map_err(|problem| PushStoreError::Malformed { path, problem })
    }

    /// Returns the public key that browsers subscribe for (`applicationServerKey`), in base64 for
    /// addresses.
    pub fn public_key(&self) -> &str {
        self.identity.public()
    }

    pub(crate) fn key(&self) -> &PushIdentity {
        &self.identity
    }

    /// Adds a subscription. One with the same endpoint is replaced.
    ///
    /// # Errors
    ///
    /// Returns an error if the subscription names no known push service, if its keys are none, if
    /// there are too many, or if the file cannot be written.
    pub fn subscribe(&self, subscription: PushSubscription) -> Result<(), PushStoreError> {
        self.address_of(&subscription)?;
        subscription.keys().map_err(PushStoreError::Subscription)?;
        self.change(|known| {
            known.retain(|known| known.endpoint != subscription.endpoint);
            if known.len() >= SUBSCRIPTIONS_MAX {
                return Err(PushStoreError::Full);
            }
            known.push(subscription);
            Ok(())
        })
    }

    /// Removes the subscription with this endpoint, if there is one.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read or written.
    pub fn unsubscribe(&self, endpoint: &str) -> Result<(), PushStoreError> {
        self.change(|known| {
            known.retain(|known| known.endpoint != endpoint);
            Ok(())
        })
    }

    /// Removes all subscriptions of a person, for example because the person was removed.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read or written.
    pub fn forget_person(&self, person: &str) -> Result<(), PushStoreError> {
        self.change(|known| {
            known.retain(|known| known.person != person);
            Ok(())
        })
    }

    /// Returns all subscriptions.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read.
    pub fn subscriptions(&self) -> Result<Vec<PushSubscription>, PushStoreError> {
        Ok(read_json(&self.file())?.unwrap_or_default())
    }

    /// Returns the address of a subscription, if its push service is known.
    pub(crate) fn address_of(
        &self,
        subscription: &PushSubscription,
    ) -> Result<ReceiverAddress, PushStoreError> {
        let wrong = |why: &str| PushStoreError::Subscription(why.to_owned());
        if subscription.endpoint.len() > ENDPOINT_BYTES_MAX {
            return Err(wrong("its address is too long"));
        }
        let address = ReceiverAddress::parse(&subscription.endpoint).map_err(wrong)?;
        if !self.services.iter().any(|service| is_of(service, &address)) {
            let origin = address.origin();
            return Err(PushStoreError::Subscription(format!(
                "{origin} is no known push service; `services` of the notifier may name it"
            )));
        }
        Ok(address)
    }

    fn file(&self) -> PathBuf {
        self.folder.join("subscriptions.json")
    }

    /// Changes the subscriptions, alone.
    fn change(
        &self,
        change: impl FnOnce(&mut Vec<PushSubscription>) -> Result<(), PushStoreError>,
    ) -> Result<(), PushStoreError> {
        let _lock = lock(&self.folder)?;
        let mut subscriptions = self.subscriptions()?;
        let before = subscriptions.clone();
        change(&mut subscriptions)?;
        if subscriptions == before {
            return Ok(());
        }
        write_json(&self.file(), &subscriptions)
    }
}

/// Whether an address is one of a service: an origin, or `https://*.` and the end of one.
fn is_of(service: &str, address: &ReceiverAddress) -> bool {
    match service.strip_prefix("https://*.") {
        Some(end) => {
            let front = address.authority();
            let front = front.strip_suffix(end).and_then(|front| front.strip_suffix('.'));
            address.is_encrypted && front.is_some_and(|front| !front.is_empty())
        }
        None => service == address.origin(),
    }
}

/// Waits until no other process changes the store.
fn lock(folder: &Path) -> Result<File, PushStoreError> {
    let path = folder.join("lock");
    let open = OpenOptions::new().create(true).truncate(false).write(true).mode(0o600).open(&path);
    let locked = open.and_then(|file| file.lock().map(|()| file));
    locked.map_err(|source| PushStoreError::File { path, source })
}

/// Reads a file; `None` if it is missing.
fn read(path: &Path) -> Result<Option<String>, PushStoreError> {
    let failed = |source| PushStoreError::File { path: path.to_owned(), source };
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(failed(error)),
        Ok(about) if about.len() > FILE_BYTES_MAX => {
            return Err(failed(io::Error::other("it is longer than any that was written")));
        }
        Ok(_) => (),
    }
    fs::read_to_string(path).map(Some).map_err(failed)
}

fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<Option<T>, PushStoreError> {
    let Some(text) = read(path)? else { return Ok(None) };
    let parsed = serde_json::from_str(&text);
    parsed.map(Some).map_err(|error| PushStoreError::Malformed {
        path: path.to_owned(),
        problem: error.to_string(),
    })
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), PushStoreError> {
    let text = serde_json::to_vec(value);
    let text = text.map_err(|error| PushStoreError::Malformed {
        path: path.to_owned(),
        problem: error.to_string(),
    })?;
    replace(path, &text)
}

/// Replaces a file as a whole; only its owner may read it, from its first byte on.
fn replace(path: &Path, content: &[u8]) -> Result<(), PushStoreError> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let written = || {
        let mut options = OpenOptions::new();
        let options = options.create(true).truncate(true).write(true).mode(0o600);
        let mut file = options.open(&beside)?;
        file.write_all(content)?;
        // Without this, the rename could reach the disk before the content.
        file.sync_all()?;
        fs::rename(&beside, path)
    };
    written().map_err(|source| PushStoreError::File { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    const PUBLIC: &str =
        "BCVxsr7N_eNgVRqvHtD0zTZsEc6-VV-JvLexhqUzORcxaOzi6-AYWXvTBHm4bjyPjs7Vd8pZGH6SRpkNtoIAiw4";

    fn subscription(endpoint: &str) -> PushSubscription {
        let keys =
            PushKeys { p256dh: PUBLIC.to_owned(), auth: "BTBZMqHH6r4Tts7J_aSIgg".to_owned() };
        PushSubscription { endpoint: endpoint.to_owned(), keys, person: "ann".to_owned() }
    }

    fn known() -> Vec<String> {
        KNOWN_SERVICES.map(str::to_owned).to_vec()
    }

    #[test]
    fn subscriptions_and_the_key_outlive_a_process_and_are_closed_to_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let agent = AgentId::new("notifier").expect("a name");
        let missing = PushStore::open(folder.path(), &agent);
        assert!(matches!(missing, Err(PushStoreError::Missing)));
        let inside = PushStore::folder_of(folder.path(), &agent);
        let store = PushStore::create(&inside, &known()).expect("made");
        store.subscribe(subscription("https://fcm.googleapis.com/a")).expect("taken");
        store.subscribe(subscription("https://fcm.googleapis.com/a")).expect("replaced");
        store.subscribe(subscription("https://x.notify.windows.com/b")).expect("taken");
        let again = PushStore::open(folder.path(), &agent).expect("there");
        assert_eq!(again.public_key(), store.public_key());
        assert_eq!(again.subscriptions().expect("read").len(), 2);
        for entry in fs::read_dir(&inside).expect("a folder") {
            let entry = entry.expect("a file");
            let mode = entry.metadata().expect("a file").permissions().mode();
            assert_eq!(mode & 0o077, 0, "{}", entry.path().display());
        }
        again.unsubscribe("https://fcm.googleapis.com/a").expect("removed");
        assert_eq!(store.subscriptions().expect("read").len(), 1);
        again.forget_person("ann").expect("removed");
        assert!(store.subscriptions().expect("read").is_empty());
    }

    #[test]
    fn only_known_services_and_whole_keys_are_taken() {
        let folder = tempfile::tempdir().expect("a folder");
        let services = [known(), vec!["http://127.0.0.1:8080".to_owned()]].concat();
        let store = PushStore::create(folder.path(), &services).expect("made");
        for (endpoint, is_known) in [
            ("https://web.push.apple.com/x", true),
            ("http://127.0.0.1:8080/x", true),
            ("https://push.apple.com/x", false),
            ("https://evilpush.apple.com/x", false),
            ("https://web.push.apple.com:8443/x", false),
            ("https://fcm.googleapis.com.example/x", false),
            ("http://127.0.0.1:8081/x", false),
            ("https://192.168.1.1/x", false),
            ("file:///etc/passwd", false),
        ] {
            let taken = store.subscribe(subscription(endpoint));
            assert_eq!(taken.is_ok(), is_known, "{endpoint}");
        }
        let mut short = subscription("https://fcm.googleapis.com/a");
        short.keys.auth = "AAAA".to_owned();
        assert!(matches!(store.subscribe(short), Err(PushStoreError::Subscription(_))));
    }

    #[test]
    fn a_file_that_was_torn_is_told_with_its_place() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = PushStore::create(folder.path(), &known()).expect("made");
        fs::write(store.file(), "[{").expect("written");
        let error = store.subscribe(subscription("https://fcm.googleapis.com/a"));
        let error = error.expect_err("torn").to_string();
        assert!(error.contains("subscriptions.json"), "{error}");
    }
}
