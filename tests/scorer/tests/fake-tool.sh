#!/bin/sh
# Stands for hil-sim: says what the test put beside it, and counts how often it is asked.
here=$(dirname "$0")
command=$1
while [ $# -gt 0 ]; do
    case $1 in
        --rig) rig=$2 ;;
        --drive) drive=$2 ;;
        --out) out=$2 ;;
        --without) without=$2 ;;
    esac
    shift
done
if [ "$command" = simulate ]; then
    # the nominal rig is 10 kPa off, the fitted one not at all
    case $rig in
        *fitted*) cp "$drive" "$out" ;;
        *) awk -F, -v OFS=, 'NR > 1 { $3 += 10000 } 1' "$drive" > "$out" ;;
    esac
    exit
fi
given=$(dirname "$rig")
case=$(dirname "$given")
id=$(basename "$case")
echo "$id" >> "$here/asked"
# nothing of the answer may be there to read
[ "$(ls "$case" | sort | tr '\n' ' ')" = "given out stderr.txt stdout.txt " ] || exit 9
[ "$(ls "$given" | tr '\n' ' ')" = \
    "fit-1.csv fit-2.csv rig.toml validate-1.csv validate-2.csv " ] || exit 9
if [ -e "$here/$id.sleep" ]; then exec sleep 60; fi
if [ -n "$without" ]; then id=without-$without; fi
if [ ! -e "$here/$id.json" ]; then echo "no diagnosis for you" >&2; exit 1; fi
cp "$here/$id.json" "$out/diagnosis.json"
cp "$rig" "$out/rig.fitted.toml"
