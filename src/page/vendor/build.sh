#!/usr/bin/env bash
# Makes the minified libraries of the report again, from the packages and versions in package-lock.json.
#
# build.sh          writes them beside this file
# build.sh --check  compares them with what is there, and fails if a byte differs
#
# Needs Node 20 or newer with npm, and the npm registry.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$here/package.json" "$here/package-lock.json" "$here/ogl.js" "$work/"
cd "$work"
# esbuild's own program is one of its packages; no package needs to run anything to be installed
npm ci --ignore-scripts --no-audit --no-fund --silent
npx --no-install esbuild ogl.js --bundle --minify --format=iife --global-name=ogl --target=es2020 --charset=ascii --outfile=ogl.min.js --log-level=warning
cp node_modules/uplot/dist/uPlot.iife.min.js uplot.min.js
cp node_modules/uplot/dist/uPlot.min.css uplot.min.css
status=0
for file in ogl.min.js uplot.min.js uplot.min.css; do
    if [ "${1:-}" = "--check" ]; then
        if ! cmp "$file" "$here/$file"; then
            status=1
        fi
    else
        cp "$file" "$here/$file"
    fi
done
exit $status
