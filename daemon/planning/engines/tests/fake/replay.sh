#!/bin/sh
# Says what Metric-FF said once: $1 with costs (-s 5), $2 without; ends with $3.
here=$(dirname "$0")
with=$1 without=$2 code=$3
for last; do :; done
case $last in
    5) cat "$here/$with" ;;
    *) cat "$here/$without" ;;
esac
exit "$code"
