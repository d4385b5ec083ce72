//! Metrics as text, in two formats: that of Prometheus, version 0.0.4, and OpenMetrics 1.0.

use std::fmt::Write as _;

use crate::family::{MetricFamily, MetricKind, Sample};

/// A text format of metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpositionFormat {
    /// The text format of Prometheus, version 0.0.4.
    Prometheus,
    /// OpenMetrics, version 1.0.0.
    OpenMetrics,
}

/// The media type of OpenMetrics, as clients ask for it.
const OPEN_METRICS: &str = "application/openmetrics-text";

/// Ending of the names of counters. OpenMetrics leaves it out where it describes a metric.
const TOTAL: &str = "_total";

impl ExpositionFormat {
    /// Returns the format for a client that accepts these media types: OpenMetrics if the client
    /// names it, and prefers nothing else to it.
    pub fn accepted(accept: &str) -> ExpositionFormat {
        let quality = |wanted: &str| {
            let ranges = accept.split(',').map(str::trim);
            let matching = ranges.filter(|range| {
                range.split(';').next().is_some_and(|media| media.trim() == wanted)
            });
            matching.map(quality_of).fold(0.0, f32::max)
        };
        let open = quality(OPEN_METRICS);
        if open > 0.0 && open >= quality("text/plain") {
            ExpositionFormat::OpenMetrics
        } else {
            ExpositionFormat::Prometheus
        }
    }

    /// Returns the value of the header `Content-Type` for a text in this format.
    pub fn content_type(self) -> &'static str {
        match self {
            ExpositionFormat::Prometheus => "text/plain; version=0.0.4; charset=utf-8",
            ExpositionFormat::OpenMetrics => {
                "application/openmetrics-text; version=1.0.0; charset=utf-8"
            }
        }
    }

    /// Writes metrics as text in this format.
    pub fn write(self, families: &[MetricFamily]) -> String {
        let mut text = String::new();
        for family in families {
            self.describe(&mut text, family);
            family.samples.iter().for_each(|sample| self.sample(&mut text, family.name, sample));
        }
        if self == ExpositionFormat::OpenMetrics {
            text.push_str("# EOF\n");
        }
        text
    }

    fn describe(self, text: &mut String, family: &MetricFamily) {
        let MetricFamily { name, help, unit, kind, .. } = *family;
        let name = match (self, kind) {
            (ExpositionFormat::OpenMetrics, MetricKind::Counter) => {
                name.strip_suffix(TOTAL).unwrap_or(name)
            }
            _ => name,
        };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "# HELP {name} {}", escaped(help));
        let _ = writeln!(text, "# TYPE {name} {}", kind.as_str());
        if self == ExpositionFormat::OpenMetrics && !unit.is_empty() {
            let _ = writeln!(text, "# UNIT {name} {unit}");
        }
    }

    fn sample(self, text: &mut String, name: &str, sample: &Sample) {
        let Sample { suffix, labels, value } = sample;
        let _ = write!(text, "{name}{suffix}");
        for (index, (label, value)) in labels.iter().enumerate() {
            let opening = if index == 0 { '{' } else { ',' };
            let _ = write!(text, "{opening}{label}=\"{}\"", escaped(value));
        }
        if !labels.is_empty() {
            text.push('}');
        }
        let _ = writeln!(text, " {}", number(*value));
    }
}

/// Returns the quality of a media range, from 0 to 1; a range without a quality has 1.
fn quality_of(range: &str) -> f32 {
    let parameters = range.split(';').skip(1).map(str::trim);
    let quality = parameters.filter_map(|each| each.strip_prefix("q=")).next();
    quality.map_or(1.0, |quality| quality.trim().parse().unwrap_or(0.0))
}

fn number(value: f64) -> String {
    if value == f64::INFINITY {
        return "+Inf".to_owned();
    }
    if value == f64::NEG_INFINITY {
        return "-Inf".to_owned();
    }
    value.to_string()
}

/// Escapes what would end a text or a line.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('\n', "\\n").replace('"', "\\\"")
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn families() -> Vec<MetricFamily> {
        let millis = Duration::from_millis;
        vec![
            MetricFamily::counter("x_sent_total", "Messages.")
                .by("kind", [("a", 3), ("b\"\n\\", 0)]),
            MetricFamily::gauge("x_memory_bytes", "Memory.").in_unit("bytes").with(1.5e9),
            MetricFamily::gauge("x_unknown", "Not known.").with_known(None),
            MetricFamily::durations("x_wait_seconds", "Waits.").distributed(
                &[("mode", "m")],
                &[(millis(5), 1), (millis(1_000), 3)],
                4,
                millis(12_000),
            ),
        ]
    }

    #[test]
    fn prometheus_gets_its_own_format() {
        let expected = r#"# HELP x_sent_total Messages.
# TYPE x_sent_total counter
x_sent_total{kind="a"} 3
x_sent_total{kind="b\"\n\\"} 0
# HELP x_memory_bytes Memory.
# TYPE x_memory_bytes gauge
x_memory_bytes 1500000000
# HELP x_unknown Not known.
# TYPE x_unknown gauge
# HELP x_wait_seconds Waits.
# TYPE x_wait_seconds histogram
x_wait_seconds_bucket{mode="m",le="0.005"} 1
x_wait_seconds_bucket{mode="m",le="1.0"} 3
x_wait_seconds_bucket{mode="m",le="+Inf"} 4
x_wait_seconds_sum{mode="m"} 12
x_wait_seconds_count{mode="m"} 4
"#;
        assert_eq!(ExpositionFormat::Prometheus.write(&families()), expected);
    }

    #[test]
    fn openmetrics_names_units_and_ends() {
        let text = ExpositionFormat::OpenMetrics.write(&families());
        for part in [
            "# TYPE x_sent counter\nx_sent_total{kind=\"a\"} 3\n",
            "# TYPE x_memory_bytes gauge\n# UNIT x_memory_bytes bytes\n",
            "# UNIT x_wait_seconds seconds\n",
        ] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert!(text.ends_with("x_wait_seconds_count{mode=\"m\"} 4\n# EOF\n"), "{text}");
    }

    #[test]
    fn the_format_is_the_one_that_the_client_prefers() {
        use ExpositionFormat::{OpenMetrics, Prometheus};
        let of_prometheus = "application/openmetrics-text;version=1.0.0;q=0.5,\
                             application/openmetrics-text;version=0.0.1;q=0.4,\
                             text/plain;version=0.0.4;q=0.3,*/*;q=0.2";
        for (accept, format) in [
            ("", Prometheus),
            ("*/*", Prometheus),
            ("text/html, */*;q=0.8", Prometheus),
            (of_prometheus, OpenMetrics),
            ("application/openmetrics-text", OpenMetrics),
            ("application/openmetrics-text;q=0.2, text/plain", Prometheus),
            ("application/openmetrics-text;q=0", Prometheus),
            ("application/openmetrics-text;q=x;;,,;", Prometheus),
        ] {
            assert_eq!(ExpositionFormat::accepted(accept), format, "{accept}");
        }
    }
}
