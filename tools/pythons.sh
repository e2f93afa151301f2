#!/usr/bin/env bash
# Prints the interpreters of the named versions that this machine has: tools/pythons.sh 3.11 3.12
# Those of pyenv are found without being switched to. At least one must be there. With --newest in
# front it prints the last of those found.
set -euo pipefail

newest=
if [ "${1:-}" = --newest ]; then
  newest=1
  shift
fi
found=()
for version in "$@"; do
  for candidate in "$(command -v "python$version" || true)" \
    "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$version".*/bin/python; do
    if [ -x "$candidate" ] && "$candidate" -c 'import venv' 2> /dev/null; then
      found+=("$candidate")
      break
    fi
  done
done
[ "${#found[@]}" -gt 0 ] || { echo "none of these Pythons is here: $*" >&2; exit 1; }
[ -z "$newest" ] || found=("${found[@]: -1}")
echo "${found[@]}"
