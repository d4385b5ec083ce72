//! Tests with daemons that enter, leave and crash, in a folder that each test creates.

use std::collections::BTreeSet;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::{UnixListener, UnixStream};

use tempfile::TempDir;
use tokio::time::Instant;

use super::*;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder")
}

fn daemon(name: &str) -> DaemonId {
    DaemonId::new(name).expect("a name")
}

async fn come(folder: &TempDir, name: &str) -> PresenceGuard {
    register_daemon(folder.path(), &daemon(name)).await.expect("the folder is ours")
}

/// Ends a daemon as a crash does: its ticket and its symbolic link stay, and its lock is released.
/// Returns the path of the symbolic link.
fn kill(folder: &TempDir, name: &str, presence: PresenceGuard) -> PathBuf {
    let ticket = folder.path().join(name).with_extension(PRESENCE_EXTENSION);
    let (said, target) = (fs::read(&ticket).expect("it lived"), presence.incarnation.clone());
    drop(presence);
    fs::write(&ticket, said).expect("the folder is ours");
    std::os::unix::fs::symlink(format!("{name}.sock"), &target).expect("its path was taken away");
    target
}

/// Returns the names of the daemons to which the daemon of `presence` connects.
fn called(presence: &PresenceGuard) -> Vec<&str> {
    let names = presence.others.iter().filter_map(|path| path.file_stem()?.to_str());
    names.collect()
}

#[tokio::test(start_paused = true)]
async fn a_daemon_connects_to_those_that_entered_before() {
    let folder = folder();
    let m = come(&folder, "m").await;
    let z = come(&folder, "z").await;
    let a = come(&folder, "a").await;
    assert_eq!([called(&m), called(&z), called(&a)], [vec![], vec!["m"], vec!["m", "z"]]);
    drop(m);
    let b = come(&folder, "b").await;
    assert_eq!(called(&b), ["a", "z"]);
    drop(a);
    assert_eq!(called(&come(&folder, "m").await), ["b", "z"], "and comes back as a newcomer");
}

#[tokio::test(start_paused = true)]
async fn no_daemon_enters_while_the_entrance_is_closed() {
    let folder = folder();
    let hub = come(&folder, "hub").await;
    let entrance = ClosedEntrance::close(folder.path()).await.expect("the folder is ours");
    assert_eq!(entrance.daemons, ["hub"]);
    let door = open(&folder.path().join(LOCK_FILE)).expect("the folder is ours");
    assert!(matches!(door.try_lock(), Err(TryLockError::WouldBlock)), "daemons wait here");
    drop(entrance);
    door.try_lock().expect("it is open again");
    drop((door, hub));
    let entrance = ClosedEntrance::close(folder.path()).await.expect("the folder is ours");
    assert!(entrance.daemons.is_empty(), "it has left");
    let nowhere = ClosedEntrance::close(&folder.path().join("none")).await.expect("no error");
    assert!(nowhere.daemons.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn only_one_of_two_simultaneous_daemons_connects() {
    let names: Vec<_> = (0..12).map(|number| format!("daemon-{number:02}")).collect();
    for _ in 0..5 {
        let folder = folder();
        let path = folder.path().to_owned();
        let coming = names.iter().map(|name| {
            let (path, daemon) = (path.clone(), daemon(name));
            tokio::spawn(async move {
                register_daemon(&path, &daemon).await.expect("the folder is ours")
            })
        });
        let coming: Vec<_> = coming.collect();
        let mut stays = Vec::new();
        for one in coming {
            stays.push(one.await.expect("no panic"));
        }
        let mut pairs = BTreeSet::new();
        for (caller, presence) in names.iter().zip(&stays) {
            for called in called(presence) {
                let pair = BTreeSet::from([caller.clone(), called.to_owned()]);
                assert!(pairs.insert(pair), "{caller} and {called} call each other");
            }
        }
        assert_eq!(pairs.len(), 12 * 11 / 2, "everyone is linked to everyone");
    }
}

#[tokio::test(start_paused = true)]
async fn a_daemon_enters_only_some_time_after_another_has_left() {
    let folder = folder();
    let began = Instant::now();
    let first = come(&folder, "first").await;
    assert_eq!(began.elapsed(), Duration::ZERO, "nobody was here");
    drop(first);
    // The time of leaving is in the future, so that the test does not depend on how busy this
    // machine is.
    leaves_at(&folder, "first", SystemTime::now() + REOPEN_DELAY);
    let other = come(&folder, "other").await;
    assert!(began.elapsed() >= REOPEN_DELAY, "came after {:?}", began.elapsed());

    leaves_at(&folder, "first", SystemTime::now() - REOPEN_DELAY);
    kill(&folder, "other", other);
    let began = Instant::now();
    let third = come(&folder, "third").await;
    assert_eq!(began.elapsed(), Duration::ZERO, "when another died, nobody knows");
    come(&folder, "other").await;
    assert!(began.elapsed() >= REOPEN_DELAY, "it may be now: came after {:?}", began.elapsed());
    drop(third);
}

#[tokio::test(start_paused = true)]
async fn a_departure_during_the_wait_prolongs_it() {
    let folder = folder();
    let (first, second) = (come(&folder, "first").await, come(&folder, "second").await);
    drop(first);
    leaves_at(&folder, "first", SystemTime::now() + REOPEN_DELAY);
    let began = Instant::now();
    let others = async {
        tokio::time::sleep(REOPEN_DELAY / 2).await;
        leaves_at(&folder, "first", SystemTime::now() - REOPEN_DELAY);
        drop(second);
        leaves_at(&folder, "second", SystemTime::now() + REOPEN_DELAY);
        tokio::time::sleep(REOPEN_DELAY).await;
        leaves_at(&folder, "second", SystemTime::now() - REOPEN_DELAY);
    };
    let (_third, ()) = tokio::join!(come(&folder, "third"), others);
    assert_eq!(began.elapsed(), 2 * REOPEN_DELAY);
}

#[tokio::test(start_paused = true)]
async fn repeated_departures_do_not_block_entry() {
    let folder = folder();
    drop(come(&folder, "first").await);
    // The ticket shows at every check that the daemon has just left.
    leaves_at(&folder, "first", SystemTime::now() + 100 * REOPEN_DELAY);
    let began = Instant::now();
    come(&folder, "second").await;
    assert!(began.elapsed() <= REOPEN_DELAY * 8, "came after {:?}", began.elapsed());
}

fn leaves_at(folder: &TempDir, name: &str, at: SystemTime) {
    let ticket = File::options()
        .write(true)
        .open(folder.path().join(name).with_extension(PRESENCE_EXTENSION));
    ticket.and_then(|ticket| ticket.set_modified(at)).expect("it was here");
}

#[test]
fn a_clock_that_was_set_back_does_not_block_entry() {
    let now = SystemTime::now();
    let ticket = |incarnation: &str, since| PresenceFile {
        daemon: "b".to_owned(),
        is_here: false,
        incarnation: incarnation.to_owned(),
        since,
    };
    for (said, expected) in [
        (vec![], Duration::ZERO),
        (vec![ticket("", now - REOPEN_DELAY)], Duration::ZERO),
        (vec![ticket("", now - REOPEN_DELAY / 5)], REOPEN_DELAY / 5 * 4),
        (
            vec![ticket("", now - REOPEN_DELAY / 5), ticket("", now - REOPEN_DELAY / 2)],
            REOPEN_DELAY / 5 * 4,
        ),
        (vec![ticket("", now + 100 * REOPEN_DELAY)], REOPEN_DELAY),
        (vec![ticket("0123456789", now)], Duration::ZERO),
        (vec![PresenceFile { is_here: true, ..ticket("", now) }], Duration::ZERO),
    ] {
        assert_eq!(remaining_delay(&said, now), expected);
    }
}

#[tokio::test(start_paused = true)]
async fn each_incarnation_has_its_own_path() {
    let folder = folder();
    let socket = folder.path().join("a.sock");
    let first = come(&folder, "a").await;
    let listener = UnixListener::bind(&socket).expect("a socket");
    let other = come(&folder, "b").await;
    assert_eq!(other.others, std::slice::from_ref(&first.incarnation));
    assert!(UnixStream::connect(&first.incarnation).is_ok());

    drop(listener);
    let old = kill(&folder, "a", first);
    assert!(UnixStream::connect(&old).is_err(), "nobody listens");
    let second = come(&folder, "a").await;
    fs::remove_file(&socket).expect("Zenoh takes it away before it listens");
    let _listener = UnixListener::bind(&socket).expect("a socket");
    assert!(UnixStream::connect(&second.incarnation).is_ok());
    assert!(UnixStream::connect(&old).is_err(), "the calls of old do not reach it");

    let incarnation = second.incarnation.clone();
    drop(second);
    assert!(fs::symlink_metadata(incarnation).is_err(), "it takes its path along");
}

#[tokio::test(start_paused = true)]
async fn a_name_is_taken_once() {
    let folder = folder();
    let first = come(&folder, "a").await;
    let second = register_daemon(folder.path(), &daemon("a")).await.expect_err("it is taken");
    assert_eq!(second.to_string(), "start as `a`: a daemon of this name is running here already");
    assert_eq!(called(&come(&folder, "b").await), ["a"], "and the first is still here");
    drop(first);
}

#[tokio::test(start_paused = true)]
async fn a_held_lock_does_not_block_entry_for_ever() {
    let folder = folder();
    let _door = acquire_lock(folder.path()).await.expect("the folder is ours");
    let _a = come(&folder, "a").await;
    assert_eq!(called(&come(&folder, "b").await), ["a"]);
}

#[tokio::test(start_paused = true)]
async fn files_that_are_no_tickets_are_ignored() {
    let folder = folder();
    for (name, text) in [("Not A Name.here", "0123456789"), ("b.here", "../elsewhere"), ("c", "")] {
        fs::write(folder.path().join(name), text).expect("the folder is ours");
    }
    let locked = File::open(folder.path().join("b.here")).expect("just written");
    locked.try_lock().expect("nobody else's");
    assert_eq!(called(&come(&folder, "a").await), [""; 0]);
}

#[tokio::test(start_paused = true)]
async fn lock_files_are_closed_to_other_users() {
    let folder = folder();
    let _a = come(&folder, "a").await;
    for name in ["a.here", LOCK_FILE] {
        let metadata = fs::metadata(folder.path().join(name)).expect("it is used");
        assert_eq!(metadata.permissions().mode() & 0o777, 0o600, "{name}");
    }
}

#[test]
fn paths_of_incarnations_are_no_longer_than_sockets() {
    let longest = "a".repeat(100 - ".sock".len());
    let incarnation = Path::new(&longest).with_extension(incarnation_name(SystemTime::now()));
    assert!(incarnation.as_os_str().len() < 108, "room for the final zero");
    assert!(
        is_incarnation_name(&incarnation_name(UNIX_EPOCH))
            && is_incarnation_name(&incarnation_name(SystemTime::now()))
    );
}
