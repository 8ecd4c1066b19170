#!/bin/sh
# The pictures of the README, from the project's own scenes: ./docs/pictures.sh
set -eu
cd "$(dirname "$0")/.."
cargo build --release
render() {
    name=$1 scene=$2
    shift 2
    target/release/caustica render "scenes/$scene.xml" --size 256x256 -q -o "docs/images/$name.png" "$@"
}

# The map shown directly: the classic two-pass algorithm is a single pass.
map="--passes 1 --set final_gather=false --set direct=map"
render map-100k cornell-spheres $map --set global_photons=100000 --set global_k=50
render map-500k cornell-spheres $map --set global_photons=500000 --set global_k=500
target/release/caustica photons scenes/cornell-spheres.xml --size 256x256 -q -o docs/images/photons.png \
    --set global_photons=10000 --set caustic_photons=5000
render indirect-10k cornell-spheres --passes 1 --set final_gather=false --set direct=off \
    --set global_photons=10000 --set global_k=500 --set global_radius=0.5

# One pass of photons, and what more passes converge to.
render ring-50k ring --passes 1 --set caustic_photons=50000 --set caustic_k=50
render ring ring --passes 64
render glossy-340k glossy-caustic --passes 1 --set caustic_photons=340000 --set caustic_k=100
render glossy glossy-caustic --passes 64
render environment env-caustic --passes 64 --exposure -0.7
render cornell-spheres cornell-spheres --passes 64
render pool pool --passes 64 --exposure 1
