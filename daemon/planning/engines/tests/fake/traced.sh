#!/bin/sh
# Tells the file $1 its process group, then becomes the rest.
echo $$ >"$1"
shift
exec "$@"
