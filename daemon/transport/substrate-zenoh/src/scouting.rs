//! Scouting: how daemons of one network find each other without configured addresses. They use
//! multicast, and gossip, in which daemons pass on the addresses of others.
//!
//! The `[zenoh]` table may contain `scouting = true` or `false`, or override single scouting
//! settings of Zenoh. Without such a setting, a daemon scouts if the ecosystem is secured and the
//! daemon listens beyond its machine, because it then takes part in a network anyway. An ecosystem
//! in plain text does not listen beyond its machine, so scouting would be of no use.
//!
//! Each ecosystem scouts at a port of its own, computed from its name, so that two ecosystems on
//! one network do not even receive each other's packets. The ports only reduce noise; the
//! authorities of their certificates and the prefix of their key expressions keep ecosystems apart.

use acl::EcosystemId;
use serde_json::{Value, json};

use crate::endpoint;
use crate::json_merge::merge;
use crate::open_error::OpenError;

/// Multicast address for scouting, which is Zenoh's own group. The address is in the block
/// 224.0.0.0/24, which is never routed beyond a network, and which cheap switches pass on to all
/// hosts without a subscription.
const GROUP: &str = "224.0.0.224";

/// Smallest port at which an ecosystem scouts. The ports are below the range from which Linux picks
/// ports (32768 and up), and do not include Zenoh's own (7446), where foreign routers would receive
/// every packet.
const PORT_FIRST: u16 = 20_000;
const PORTS: u16 = 10_000;
const _: () = assert!(PORT_FIRST + PORTS < 32_768);

/// Endpoint of a daemon that scouts and has no endpoint for others: any address, and a port that
/// the kernel chooses and that scouting announces. The address is IPv4, because the multicast group
/// is IPv4.
const ANYWHERE: &str = "tls/0.0.0.0:0";

/// Completes the scouting settings in `said`, the `[zenoh]` table: the settings of the file
/// override the defaults of this module. Returns the endpoint on which the daemon has to listen for
/// scouting in addition to `listen`, if any.
///
/// # Errors
///
/// Returns an error if the ecosystem file asks for scouting in an ecosystem that is not secured.
pub(crate) fn complete_settings(
    ecosystem: &EcosystemId,
    is_secured: bool,
    listen: &[String],
    said: &mut Value,
) -> Result<Option<String>, OpenError> {
    let asked = said.get("scouting").and_then(Value::as_bool);
    let table = said.as_object_mut();
    let own = table.and_then(|table| table.remove("scouting")).filter(Value::is_object);
    if asked == Some(true) && !is_secured {
        return Err(OpenError::ScoutingUnsecured);
    }
    let listens_beyond = listen.iter().any(|each| endpoint::leaves_machine(each));
    let scouts = asked.unwrap_or(is_secured && listens_beyond);
    let mut settings = if scouts { ours(ecosystem) } else { json!({}) };
    own.into_iter().for_each(|own| merge(&mut settings, &own));
    said["scouting"] = settings;
    Ok((scouts && !listens_beyond).then(|| ANYWHERE.to_owned()))
}

/// Returns the default settings for scouting. Of two daemons that find each other, the one with the
/// greater id connects, because Zenoh could close both links if both connected at once. Gossip
/// passes addresses on by one step. A daemon that gets an address from a hub connects to that
/// address itself, so the link remains if the hub is lost.
fn ours(ecosystem: &EcosystemId) -> Value {
    let found = json!({
        "enabled": true,
        "autoconnect": { "router": ["router"] },
        "autoconnect_strategy": { "router": { "to_router": "greater-zid" } },
    });
    let mut multicast = found.clone();
    multicast["address"] = json!(format!("{GROUP}:{}", port(ecosystem)));
    json!({ "multicast": multicast, "gossip": found })
}

/// Opens a session that scouts at the multicast address `at`. If the address cannot be used, the
/// session opens without multicast, because a daemon that cannot be found is better than none.
pub(crate) async fn open(settings: zenoh::Config, at: &str) -> zenoh::Result<zenoh::Session> {
    let mut without = settings.clone();
    let problem = match zenoh::open(settings).await {
        Ok(session) => {
            tracing::info!(at, "looks for the ecosystem's daemons on this network");
            return Ok(session);
        }
        Err(problem) => problem,
    };
    without.insert_json5("scouting/multicast/enabled", "false")?;
    let session = zenoh::open(without).await?;
    tracing::warn!(at, %problem, "failed to look for daemons on this network; none is found there");
    Ok(session)
}

/// Returns the port at which an ecosystem scouts. The port is computed by FNV-1a, because every
/// version on every machine must compute the same port.
fn port(ecosystem: &EcosystemId) -> u16 {
    let offset = acl::fnv::hash_32(ecosystem.as_str().as_bytes()) % u32::from(PORTS);
    PORT_FIRST + u16::try_from(offset).expect("invariant: less than PORTS")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ecosystem(name: &str) -> EcosystemId {
        EcosystemId::new(name).expect("a name")
    }

    /// Returns the scouting settings that follow from the `[zenoh]` table `said`, and the
    /// additional endpoint to listen on.
    fn settled(secured: bool, listen: &str, said: &Value) -> (Value, Option<String>) {
        let mut said = said.clone();
        let listen = [listen.to_owned()];
        let besides =
            complete_settings(&ecosystem("office"), secured, &listen, &mut said).expect("it may");
        (said["scouting"].clone(), besides)
    }

    #[test]
    fn a_daemon_that_listens_beyond_its_machine_scouts_by_default() {
        let (here, beyond) = ("tls/127.0.0.1:0", "tls/[::]:7447");
        let socket = "unixsock-stream//run/office.sock";
        for (secured, listen, said, expected) in [
            (true, beyond, json!({}), true),
            (true, here, json!({}), false),
            (true, socket, json!({}), false),
            (false, socket, json!({}), false),
            (true, beyond, json!({ "scouting": false }), false),
            (false, socket, json!({ "scouting": false }), false),
            (true, here, json!({ "scouting": true }), true),
        ] {
            let (settings, _) = settled(secured, listen, &said);
            let multicast = &settings["multicast"]["enabled"];
            assert_eq!(*multicast == json!(true), expected, "{secured} {listen} {said}");
        }
    }

    #[test]
    fn a_scouting_daemon_listens_beyond_its_machine() {
        let asked = json!({ "scouting": true });
        assert_eq!(settled(true, "tls/127.0.0.1:0", &asked).1.as_deref(), Some(ANYWHERE));
        assert_eq!(settled(true, "tls/[::]:7447", &asked).1, None);
        assert_eq!(settled(true, "tls/127.0.0.1:0", &json!({})).1, None);
    }

    #[test]
    fn an_ecosystem_in_plain_text_cannot_scout() {
        let mut said = json!({ "scouting": true });
        let refused = complete_settings(&ecosystem("office"), false, &[], &mut said);
        assert!(matches!(refused, Err(OpenError::ScoutingUnsecured)));
    }

    #[test]
    fn zenohs_own_settings_override_the_defaults() {
        let own = json!({ "multicast": { "address": "239.0.0.1:7446" } });
        let said = json!({ "scouting": own });
        let (settings, _) = settled(true, "tls/[::]:7447", &said);
        assert_eq!(settings["multicast"]["address"], json!("239.0.0.1:7446"));
        assert_eq!(settings["multicast"]["enabled"], json!(true));
        assert_eq!(settled(false, "tcp/127.0.0.1:0", &said).0, own, "handed on as it is");
    }

    #[test]
    fn each_ecosystem_scouts_at_a_port_of_its_own() {
        assert_eq!(port(&ecosystem("smart-office")), port(&ecosystem("smart-office")));
        let ports = ["smart-office", "ward", "campus", "house", "firm", "office"]
            .map(|name| port(&ecosystem(name)));
        let different: std::collections::BTreeSet<_> = ports.iter().collect();
        assert_eq!(different.len(), ports.len(), "{ports:?}");
        assert!(ports.iter().all(|port| (PORT_FIRST..PORT_FIRST + PORTS).contains(port)));
    }
}
