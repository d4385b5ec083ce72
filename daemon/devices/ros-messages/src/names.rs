//! Names of packages, types, fields and constants, as ROS spells them.

/// Returns the name of a type as DDS and rmw_zenoh spell it; `None` if `type_name` is not of the
/// form `package/msg/Name`, with `srv` or `action` for `msg`. For instance,
/// `nav2_msgs::action::dds_::NavigateToPose_SendGoal_` stands for
/// `nav2_msgs/action/NavigateToPose_SendGoal`.
pub fn dds_name(type_name: &str) -> Option<String> {
    let (package, kind, name) = parts(type_name)?;
    Some(format!("{package}::{kind}::dds_::{name}_"))
}

/// Returns the package, the kind and the name in the full name of a type; `None` if it is no full
/// name.
pub(crate) fn parts(type_name: &str) -> Option<(&str, &str, &str)> {
    let mut parts = type_name.split('/');
    let (package, kind, name) = (parts.next()?, parts.next()?, parts.next()?);
    let is_known_kind = ["msg", "srv", "action"].contains(&kind);
    let is_complete = is_known_kind && parts.next().is_none();
    (is_complete && is_package(package) && is_type(name)).then_some((package, kind, name))
}

fn is_lower(letter: char) -> bool {
    letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_'
}

/// Whether a package may have the name; fields follow the same rule.
pub(crate) fn is_package(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.chars().all(is_lower)
        && !name.contains("__")
        && !name.ends_with('_')
}

/// Whether a field may have the name.
pub(crate) fn is_field(name: &str) -> bool {
    is_package(name)
}

/// Whether a constant may have the name.
pub(crate) fn is_constant(name: &str) -> bool {
    let is_upper = |letter: char| letter.is_ascii_uppercase() || letter.is_ascii_digit();
    name.starts_with(|first: char| first.is_ascii_uppercase())
        && name.chars().all(|letter| is_upper(letter) || letter == '_')
        && !name.contains("__")
        && !name.ends_with('_')
}

/// Whether a file may define a type of the name.
pub(crate) fn is_plain_type(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_uppercase())
        && name.chars().all(|letter| letter.is_ascii_alphanumeric())
}

/// Whether a type may have the name. Types that ROS derives from services and actions have parts
/// after underscores, such as `NavigateToPose_SendGoal_Request`.
pub(crate) fn is_type(name: &str) -> bool {
    name.split('_').all(is_plain_type)
}
