// Numbers that the page has seen, for charts: the last values of each fact that has one.

import { watchTopic } from "./topics.js";

// Values per fact, and facts; a page that is open for a week stays small.
const VALUES_MAX = 900;
const FACTS_MAX = 400;

const series = new Map();

watchTopic("facts", (event) => {
  for (const [key, row] of Object.entries(event.rows ?? {})) {
    if (typeof row.value !== "number" || row.truth === "unknown") continue;
    if (!series.has(key)) {
      if (series.size >= FACTS_MAX) series.delete(series.keys().next().value);
      series.set(key, []);
    }
    const values = series.get(key);
    const at = event.now;
    const last = values[values.length - 1];
    if (last && last.at >= at) continue;
    values.push({ at, value: row.value });
    if (values.length > VALUES_MAX) values.shift();
  }
});

// Returns the values of a fact that the page has seen, oldest first.
export function seen(fact) {
  return series.get(fact) ?? [];
}
