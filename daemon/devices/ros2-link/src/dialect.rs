//! The two ways in which ROS names become keys of Zenoh.
//!
//! | | `zenoh-bridge-ros2dds` | `rmw_zenoh` |
//! |---|---|---|
//! | key of a topic or service | its name | domain, name, DDS name of the type, hash of the type |
//! | attachment of a message | none | number, time and sender |
//!
//! Names have no leading slash in keys. Subscriptions and calls leave the hash open (`*`), because
//! the hash of a type may differ between distributions of ROS while its messages can be read.

use std::str::FromStr;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use ros_messages::{Interfaces, UnknownTypeError, dds_name};
use serde::Deserialize;

/// Number of bytes that identify a ROS entity.
const GID_BYTES: usize = 16;

/// The way in which ROS names become keys of Zenoh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize)]
#[serde(try_from = "String")]
pub enum RosDialect {
    /// The way of `zenoh-bridge-ros2dds`, for robots with nodes that use DDS.
    #[default]
    Ros2Dds,
    /// The way of `rmw_zenoh`, for robots with nodes that use Zenoh themselves.
    RmwZenoh,
}

impl RosDialect {
    /// Whether the domain of ROS is a part of the keys. A bridge has one domain, which it names by
    /// itself.
    pub fn has_domain(self) -> bool {
        self == RosDialect::RmwZenoh
    }
}

impl FromStr for RosDialect {
    type Err = String;

    fn from_str(text: &str) -> Result<RosDialect, String> {
        match text {
            "ros2dds" => Ok(RosDialect::Ros2Dds),
            "rmw-zenoh" => Ok(RosDialect::RmwZenoh),
            _ => Err(format!(
                "there is no dialect `{text}`: write `ros2dds` (the robot runs \
                 zenoh-bridge-ros2dds) or `rmw-zenoh` (its nodes run with rmw_zenoh)"
            )),
        }
    }
}

impl TryFrom<String> for RosDialect {
    type Error = String;

    fn try_from(text: String) -> Result<RosDialect, String> {
        text.parse()
    }
}

/// Makes the keys and attachments of one robot.
pub(crate) struct RosKeys {
    dialect: RosDialect,
    /// Namespace of the robot without slashes at its ends; may be empty.
    namespace: String,
    domain_id: u32,
    gid: [u8; GID_BYTES],
    sequence: AtomicI64,
}

impl RosKeys {
    pub(crate) fn new(dialect: RosDialect, namespace: &str, domain_id: u32) -> RosKeys {
        let mut gid = [0; GID_BYTES];
        fastrand::Rng::new().fill(&mut gid);
        let namespace = namespace.trim_matches('/').to_owned();
        RosKeys { dialect, namespace, domain_id, gid, sequence: AtomicI64::new(0) }
    }

    /// Returns the full name of a topic, service or action, without a leading slash. A name that
    /// begins with a slash is not in the robot's namespace.
    pub(crate) fn full_name(&self, name: &str) -> String {
        match name.strip_prefix('/') {
            Some(absolute) => absolute.to_owned(),
            None if self.namespace.is_empty() => name.to_owned(),
            None => format!("{}/{name}", self.namespace),
        }
    }

    /// Returns the key under which messages of a topic are received, and under which a service is
    /// called.
    pub(crate) fn any_hash(&self, name: &str, type_name: &str) -> Result<String, UnknownTypeError> {
        self.key(name, type_name, "*")
    }

    /// Returns the key under which messages of a topic are published.
    pub(crate) fn exact(
        &self,
        name: &str,
        type_name: &str,
        interfaces: &Interfaces,
    ) -> Result<String, UnknownTypeError> {
        let hash = match self.dialect {
            RosDialect::Ros2Dds => String::new(),
            RosDialect::RmwZenoh => interfaces.type_hash(type_name)?,
        };
        self.key(name, type_name, &hash)
    }

    fn key(&self, name: &str, type_name: &str, hash: &str) -> Result<String, UnknownTypeError> {
        let full_name = self.full_name(name);
        match self.dialect {
            RosDialect::Ros2Dds => Ok(full_name),
            RosDialect::RmwZenoh => {
                let dds = dds_name(type_name).ok_or_else(|| UnknownTypeError {
                    name: type_name.to_owned(),
                    advice: "a full name is such as `geometry_msgs/msg/Pose`".to_owned(),
                })?;
                Ok(format!("{}/{full_name}/{dds}/{hash}", self.domain_id))
            }
        }
    }

    /// Returns the attachment of the next message; `None` if the dialect has none.
    pub(crate) fn attachment(&self) -> Option<Vec<u8>> {
        if self.dialect == RosDialect::Ros2Dds {
            return None;
        }
        let number = self.sequence.fetch_add(1, Ordering::Relaxed) + 1;
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let nanoseconds = i64::try_from(since.as_nanos()).unwrap_or(i64::MAX);
        let mut bytes = Vec::with_capacity(2 * size_of::<i64>() + 1 + GID_BYTES);
        bytes.extend(number.to_le_bytes());
        bytes.extend(nanoseconds.to_le_bytes());
        bytes.push(GID_BYTES as u8);
        bytes.extend(self.gid);
        Some(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: &str = "geometry_msgs/msg/PoseStamped";

    fn keys(dialect: RosDialect, namespace: &str) -> RosKeys {
        RosKeys::new(dialect, namespace, 7)
    }

    #[test]
    fn keys_of_the_bridge_are_names_of_ros() {
        let robot = keys(RosDialect::Ros2Dds, "/tb1");
        assert_eq!(robot.any_hash("amcl_pose", POSE).expect("a type"), "tb1/amcl_pose");
        assert_eq!(robot.any_hash("/tf", POSE).expect("a type"), "tf");
        assert_eq!(keys(RosDialect::Ros2Dds, "").any_hash("odom", POSE).expect("a type"), "odom");
        assert_eq!(robot.attachment(), None);
    }

    #[test]
    fn keys_of_rmw_zenoh_have_the_domain_the_type_and_its_hash() {
        let robot = keys(RosDialect::RmwZenoh, "tb1");
        let dds = "geometry_msgs::msg::dds_::PoseStamped_";
        assert_eq!(robot.any_hash("goal", POSE).expect("a type"), format!("7/tb1/goal/{dds}/*"));
        let exact = robot.exact("goal", POSE, &Interfaces::standard()).expect("a type");
        assert!(exact.starts_with(&format!("7/tb1/goal/{dds}/RIHS01_")), "{exact}");
    }

    #[test]
    fn attachments_of_rmw_zenoh_are_numbered() {
        let robot = keys(RosDialect::RmwZenoh, "");
        let (first, second) = (robot.attachment().expect("one"), robot.attachment().expect("one"));
        assert_eq!((first.len(), first[0], second[0], first[16]), (33, 1, 2, 16));
        assert_eq!(first[17..], second[17..], "the sender is the same");
    }

    #[test]
    fn an_unknown_dialect_is_refused_with_the_known_ones() {
        let error = "dds".parse::<RosDialect>().expect_err("no dialect");
        assert!(error.contains("`ros2dds`") && error.contains("`rmw-zenoh`"), "{error}");
    }
}
