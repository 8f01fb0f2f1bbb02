#!/usr/bin/env bash
# What a newcomer gets: the README's two commands and the wheel, in an empty clone of what is committed,
# with an empty home and nothing else of this machine.
#
#   tests/newcomer.sh             torch as PyPI has it (for Linux with CUDA, unless an index of CPU builds answers)
#   tests/newcomer.sh WHEELS      torch from a folder of wheels (a CPU build), by PIP_FIND_LINKS
#
# It works in a folder under $TMPDIR, which it removes.
set -uo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
wheels=${1:+$(cd "$1" && pwd)}
work=$(mktemp -d)
mkdir "$work/home"
trap 'rm -rf "$work"' EXIT
failed=0

clean() { # a command with HOME, PATH, LANG, the certificates and pip's settings of this script alone
    env -i HOME="$work/home" PATH="$PATH" LANG=C.UTF-8 PIP_CONFIG_FILE=/dev/null \
        ${PIP_CERT:+PIP_CERT="$PIP_CERT"} ${SSL_CERT_FILE:+SSL_CERT_FILE="$SSL_CERT_FILE"} \
        ${wheels:+PIP_FIND_LINKS="$wheels"} "$@"
}

step() { # name, folder whose size counts, command ...
    local name=$1 folder=$2 began=$SECONDS outcome=ok
    shift 2
    clean "$@" >"$work/log" 2>&1 || outcome=FAILED failed=1
    printf '| %s | %d | %s | %s |\n' "$name" $((SECONDS - began)) \
        "$(du -sm "$folder" | awk '{printf "%.2f", $1 / 1000}')" "$outcome"
    grep -E '^torch==|^installed: torch|[0-9]+ (passed|failed).* in ' "$work/log" | sed 's/^/  /' >&2
    [ $outcome = ok ] || tail -40 "$work/log" >&2
}

git clone --quiet "$source" "$work/tree" && cd "$work/tree" || exit 1
echo "commit $(git rev-parse --short HEAD), $(python3 --version), $(nproc) cores; torch: ${wheels:-as PyPI has it}"
echo "| step | seconds | GB | outcome |"
echo "|---|---|---|---|"
step "make demo, installation" .venv make .venv/.demo
step "make demo, nothing compiled" .venv make demo
step "make demo, once more" .venv make demo
step "make test, installation" .venv make .venv/.ready
step "make test, kernels not compiled" .venv make test

smoke='
import gymnasium as gym
env = gym.make("fieldgym:fieldgym/PoseReaching-v0")
env.reset(seed=1)
env.step(env.action_space.sample())
'
learn="$smoke
from stable_baselines3 import PPO
PPO('MlpPolicy', env, n_steps=64, batch_size=64).learn(64)
"
clean python3 -m pip wheel --quiet --no-deps --wheel-dir "$work/dist" . || failed=1
wheel=$(echo "$work"/dist/fieldgym-*.whl)
notebook() { # extra, code: an installation of the wheel, tried away from the checkout
    local place="$work/notebook$1"
    python3 -m venv "$place"
    step "pip install fieldgym$1" "$place" "$place/bin/pip" install --quiet "$wheel$1"
    cd "$work" && step "first episode of fieldgym$1" "$place" "$place/bin/python" -c "$2"
}
notebook "" "$smoke"
notebook "[train]" "$learn"
exit $failed
