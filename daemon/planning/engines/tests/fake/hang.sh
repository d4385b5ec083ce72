#!/bin/sh
# Tells the pipe $HANG_PIPE, or $1, its process group and its folder, then hangs with two children and half a plan.
# Whoever reads the pipe sees its end when the last of them is dead.
exec 3>"${HANG_PIPE:-$1}"
printf '(a-go)\n(a-g' >plan
sleep 1000 &
sh -c 'sleep 1000' &
echo "$$ $PWD" >&3
wait
