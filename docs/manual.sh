#!/usr/bin/env bash
# Builds the manual with mdBook: docs/manual.sh [DIRECTORY]. The decisions are added to its table of
# contents here, so that a new one needs no line elsewhere.
set -euo pipefail
cd "$(dirname "$0")/.."
out=$(realpath -m "${1:-target/manual}")
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT
cp -r docs config "$work"
# rig-study writes its pages as HTML too; the manual makes its own.
rm -f "$work"/docs/studies/*.html
{
  printf '\n# Decisions\n\n'
  for file in docs/decisions/*.md; do
    printf -- '- [%s](%s)\n' "$(sed -n '1s/^# //p' "$file")" "${file#docs/}"
  done
} >> "$work/docs/SUMMARY.md"
"${MDBOOK:-mdbook}" build "$work/docs" --dest-dir "$out"
