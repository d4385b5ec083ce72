//! Tests of links that close and open again before the routes are computed anew: Zenoh then does
//! not send its declarations again.
//!
//! In such a moment a thread of Zenoh 1.10.2 can panic on a busy machine: `unregister_subscriber`
//! in `net/routing/hat/router/pubsub.rs` expects a context that is gone (eclipse-zenoh/zenoh#2624
//! has a similar panic). A session of which a thread has panicked proves nothing, so an attempt
//! that fails after such a panic is repeated. Daemons restart themselves after it.

use std::panic;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Once};
use std::thread;

use serde_json::json;
use substrate::Resource;
use substrate_zenoh::SessionMode;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;

use crate::daemon::{Daemon, HERE};

/// How often the link is cut.
const CUTS: usize = 3;

/// How often a test is attempted if Zenoh panics.
const ATTEMPTS: usize = 4;

/// Number of panics in threads of Zenoh.
static ZENOH_PANICS: AtomicUsize = AtomicUsize::new(0);

/// Runs a test on a runtime of its own. Repeats it if it fails after a panic in a thread of Zenoh.
fn unless_zenoh_panics<F: Future<Output = ()> + 'static>(test: fn() -> F) {
    static COUNTING: Once = Once::new();
    COUNTING.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let thread = thread::current();
            let is_zenoh =
                |name: &str| ["rx-", "net-", "acc-"].iter().any(|of| name.starts_with(of));
            if thread.name().is_some_and(is_zenoh) {
                ZENOH_PANICS.fetch_add(1, Ordering::SeqCst);
            }
            before(info);
        }));
    });
    for _ in 0..ATTEMPTS {
        let panics = ZENOH_PANICS.load(Ordering::SeqCst);
        let attempt = thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build();
            runtime.expect("a runtime").block_on(test());
        });
        match attempt.join() {
            Ok(()) => return,
            Err(failure) if ZENOH_PANICS.load(Ordering::SeqCst) == panics => {
                panic::resume_unwind(failure)
            }
            Err(_) => eprintln!("a thread of Zenoh has panicked: the test is attempted again"),
        }
    }
    panic!("Zenoh has panicked at each of {ATTEMPTS} attempts");
}

/// A relay between a daemon and the sessions that connect to `endpoint`; its connections can be
/// cut.
struct Cable {
    endpoint: String,
    cut: Arc<Notify>,
}

impl Cable {
    async fn to(daemon: &Daemon) -> Cable {
        let locators = daemon.substrate.locators();
        let target = locators[0].trim_start_matches("tcp/").to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let endpoint = format!("tcp/{}", listener.local_addr().expect("bound"));
        let cut = Arc::new(Notify::new());
        let pulled = Arc::clone(&cut);
        tokio::spawn(async move {
            while let Ok((mut near, _)) = listener.accept().await {
                let (target, pulled) = (target.clone(), Arc::clone(&pulled));
                tokio::spawn(async move {
                    let Ok(mut far) = TcpStream::connect(target).await else { return };
                    tokio::select! {
                        _ = copy_bidirectional(&mut near, &mut far) => (),
                        () = pulled.notified() => (),
                    }
                });
            }
        });
        Cable { endpoint, cut }
    }

    /// Cuts all connections; new ones are accepted at once.
    fn blink(&self) {
        self.cut.notify_waiters();
    }

    /// Opens a router that connects through this relay, and reconnects at once.
    async fn router(&self, name: &'static str) -> Daemon {
        Daemon::open(name, |config| {
            config.listen = vec![HERE.to_owned()];
            config.connect = vec![self.endpoint.clone()];
            config.zenoh = json!({ "connect": { "retry": { "period_init_ms": 5 } } });
        })
        .await
    }
}

#[test]
fn two_daemons_see_each_other_again_after_a_brief_cut() {
    unless_zenoh_panics(brief_cut);
}

async fn brief_cut() {
    let mut a = Daemon::listening("a").await;
    let cable = Cable::to(&a).await;
    let mut b = cable.router("b").await;
    let _tokens = [a.announce("x"), b.announce("y")];
    a.hear("joined y@b").await;
    b.hear("joined x@a").await;
    for number in 0..CUTS {
        cable.blink();
        a.hear("left y@b").await;
        b.hear("left x@a").await;
        a.hear("joined y@b").await;
        b.hear("joined x@a").await;
        let text = format!("call {number}");
        a.request("b", "y", &text);
        b.hear(&format!("to y request: {text}")).await;
        b.request("a", "x", &text);
        a.hear(&format!("to x request: {text}")).await;
    }
}

#[test]
fn a_brief_cut_affects_only_the_daemon_behind_it() {
    unless_zenoh_panics(brief_cut_with_others);
}

async fn brief_cut_with_others() {
    let a = Daemon::listening("a").await;
    let cable = Cable::to(&a).await;
    let mut b = cable.router("b").await;
    let connect = b.substrate.locators();
    let mut client = Daemon::open("c", |config| {
        config.mode = SessionMode::Client;
        config.connect = connect;
    })
    .await;
    let mut beside = Daemon::linked("d", &b).await;
    let _tokens = [a.announce("x"), b.announce("y"), client.announce("z"), beside.announce("w")];
    beside.hear_all(&["joined x@a", "joined y@b", "joined z@c", "joined w@d"]).await;
    for _ in 0..CUTS {
        cable.blink();
        for daemon in [&mut b, &mut client, &mut beside] {
            daemon.hear("left x@a").await;
            daemon.hear("joined x@a").await;
        }
        let answers = client.ask(None, Resource::State, None).await;
        assert_eq!(answers, ["a state -", "b state -", "c state -", "d state -"]);
    }
    while let Some(line) = beside.heard_already() {
        assert!(line.ends_with("x@a"), "{line}");
    }
}
