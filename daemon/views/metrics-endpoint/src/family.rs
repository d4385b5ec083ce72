//! A metric with its samples.

use std::time::Duration;

/// Kind of a metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MetricKind {
    /// A count that never falls while the process runs.
    Counter,
    /// A value that may fall.
    Gauge,
    /// A distribution of values.
    Histogram,
}

/// A metric: its name, its meaning and its samples.
///
/// Names, labels and units follow the rules of Prometheus: the name of a counter ends with
/// `_total`, that of a metric with a unit with the unit before it.
#[derive(Clone, Debug, PartialEq)]
pub struct MetricFamily {
    /// Name of the metric, such as `althing_messages_sent_total`.
    pub name: &'static str,
    /// Meaning of the metric, as one sentence for a person.
    pub help: &'static str,
    /// Unit of the metric, which is a part of its name; empty if it has none.
    pub unit: &'static str,
    /// Kind of the metric.
    pub kind: MetricKind,
    /// Samples of the metric.
    pub samples: Vec<Sample>,
}

/// One value of a metric.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// End of the sample's name: `_bucket`, `_sum` or `_count` of a histogram; otherwise empty.
    pub suffix: &'static str,
    /// Labels of the sample, each with its value.
    pub labels: Vec<(&'static str, String)>,
    /// The value.
    pub value: f64,
}

// === impl MetricKind ===

impl MetricKind {
    /// Returns the name of the kind, in both text formats.
    pub fn as_str(self) -> &'static str {
        match self {
            MetricKind::Counter => "counter",
            MetricKind::Gauge => "gauge",
            MetricKind::Histogram => "histogram",
        }
    }
}

// === impl MetricFamily ===

impl MetricFamily {
    /// Returns a counter without samples.
    pub fn counter(name: &'static str, help: &'static str) -> MetricFamily {
        let (unit, kind) = ("", MetricKind::Counter);
        MetricFamily { name, help, unit, kind, samples: Vec::new() }
    }

    /// Returns a gauge without samples.
    pub fn gauge(name: &'static str, help: &'static str) -> MetricFamily {
        MetricFamily { kind: MetricKind::Gauge, ..MetricFamily::counter(name, help) }
    }

    /// Returns a histogram of durations, in seconds, without samples.
    pub fn durations(name: &'static str, help: &'static str) -> MetricFamily {
        let kind = MetricKind::Histogram;
        MetricFamily { kind, unit: "seconds", ..MetricFamily::counter(name, help) }
    }

    /// Sets the unit of the metric.
    #[must_use]
    pub fn in_unit(self, unit: &'static str) -> MetricFamily {
        MetricFamily { unit, ..self }
    }

    /// Adds a sample without labels.
    #[must_use]
    pub fn with(self, value: f64) -> MetricFamily {
        self.labelled(&[], value)
    }

    /// Adds a sample without labels, if there is a value.
    #[must_use]
    pub fn with_known(self, value: Option<f64>) -> MetricFamily {
        match value {
            Some(value) => self.with(value),
            None => self,
        }
    }

    /// Adds a sample with labels.
    #[must_use]
    pub fn labelled(mut self, labels: &[(&'static str, &str)], value: f64) -> MetricFamily {
        self.push("", labels, None, value);
        self
    }

    /// Adds one sample for each pair of a value of `label` and a number.
    #[must_use]
    pub fn by<'v>(
        self,
        label: &'static str,
        values: impl IntoIterator<Item = (&'v str, u64)>,
    ) -> MetricFamily {
        values
            .into_iter()
            .fold(self, |family, (value, count)| family.labelled(&[(label, value)], count as f64))
    }

    /// Adds the samples of one histogram of durations. `at_most` has, for each bound ascending, the
    /// number of durations up to it; `count` is the number of all, and `sum` their sum.
    #[must_use]
    pub fn distributed(
        mut self,
        labels: &[(&'static str, &str)],
        at_most: &[(Duration, u64)],
        count: u64,
        sum: Duration,
    ) -> MetricFamily {
        // OpenMetrics requires `1.0` for a bound that is whole.
        for (bound, number) in at_most {
            self.push(
                "_bucket",
                labels,
                Some(format!("{:?}", bound.as_secs_f64())),
                *number as f64,
            );
        }
        self.push("_bucket", labels, Some("+Inf".to_owned()), count as f64);
        self.push("_sum", labels, None, sum.as_secs_f64());
        self.push("_count", labels, None, count as f64);
        self
    }

    fn push(
        &mut self,
        suffix: &'static str,
        labels: &[(&'static str, &str)],
        bound: Option<String>,
        value: f64,
    ) {
        let labels = labels.iter().map(|(name, value)| (*name, (*value).to_owned()));
        let labels = labels.chain(bound.map(|bound| ("le", bound))).collect();
        self.samples.push(Sample { suffix, labels, value });
    }
}
