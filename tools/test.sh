#!/usr/bin/env bash
# The one test command: format, lints, the build without GPU, documentation, tests. CI runs the same (.ci/run).
#
#   tools/test.sh                      everything
#   SKIP_GPU_TESTS=1 tools/test.sh     without a Vulkan driver: GPU tests are reported as ignored
#
# The GPU tests draw on Mesa's software Vulkan (lavapipe), so that pictures are the same on every machine. Where it is
# missing on a Debian or Ubuntu system and this runs as root, it is installed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

say() { printf '\n== %s\n' "$*"; }
fail() { printf 'error: %s\n' "$*" >&2; exit 1; }

# ---- tools ----------------------------------------------------------------------------------------------------------

command -v cargo >/dev/null || fail "cargo is missing; install Rust 1.95 or newer with rustup"
cargo fmt --version >/dev/null 2>&1 || fail "rustfmt is missing; install it with: rustup component add rustfmt"
cargo clippy --version >/dev/null 2>&1 || fail "clippy is missing; install it with: rustup component add clippy"

# ---- a Vulkan driver ------------------------------------------------------------------------------------------------

# The file that announces lavapipe to the Vulkan loader (its name holds the architecture), or nothing.
lavapipe_icd() {
    local file
    for file in /usr/share/vulkan/icd.d/lvp_icd*.json /etc/vulkan/icd.d/lvp_icd*.json; do
        if [[ -f $file ]]; then
            printf '%s' "$file"
            return
        fi
    done
}

# No `grep -q`: it would close the pipe early, and `pipefail` would take that for a failure.
has_loader() { PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep -F 'libvulkan.so.1' >/dev/null; }

if [[ $(uname -s) == Linux && ${SKIP_GPU_TESTS:-} != 1 && -z ${VK_DRIVER_FILES:-} ]]; then
    if [[ -z $(lavapipe_icd) ]] || ! has_loader; then
        install='apt-get update && apt-get install -y mesa-vulkan-drivers'
        if [[ $(id -u) != 0 ]] || ! command -v apt-get >/dev/null; then
            fail "no software Vulkan for the GPU tests. As root: $install
       (or your system's package of Mesa's Vulkan drivers). Without it: SKIP_GPU_TESTS=1 tools/test.sh"
        fi
        say "$install"
        export DEBIAN_FRONTEND=noninteractive
        apt-get update
        apt-get install -y mesa-vulkan-drivers
    fi
    icd=$(lavapipe_icd)
    [[ -n $icd ]] || fail "mesa-vulkan-drivers is installed, but brought no lavapipe (lvp_icd*.json)"
    export VK_DRIVER_FILES=$icd
fi

# Vulkan's window-system code asks for it, also where there are no windows.
if [[ -z ${XDG_RUNTIME_DIR:-} ]]; then
    XDG_RUNTIME_DIR=$(mktemp -d)
    export XDG_RUNTIME_DIR
    trap 'rm -rf -- "$XDG_RUNTIME_DIR"' EXIT
fi

# ---- checks: one profile for all of them, so that dependencies are built once -----------------------------------------

say "cargo fmt --check"
cargo fmt --check

say "cargo clippy --all-targets -- -D warnings"
cargo clippy --locked --all-targets -- -D warnings

say "cargo check --no-default-features: all but the GPU renderer"
cargo check --locked --no-default-features

say "cargo doc --no-deps"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps

say "cargo test"
cargo test --locked --no-fail-fast
