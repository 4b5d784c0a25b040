#!/bin/sh
# The main job on a copy of the committed store: score with four estimators, ask, report.
set -eu
rm -rf "$DEMO"
mkdir -p "$DEMO"
cp -R datasets "$DEMO/datasets"
export SSIL_STORE="$DEMO/datasets"

say() { printf '\n$ %s\n' "$*"; "$@"; }

say ssil-data datasets
for estimator in vae windowvae mdn gpr; do
    say ssil-data score racetrack --estimator "$estimator"
done
say ssil-data show racetrack
say ssil-data lcor racetrack --run windowvae --episode 40
say ssil-data report racetrack -o "$DEMO/report.html"
echo "Open $DEMO/report.html in a browser; the scored store is $SSIL_STORE."
