#!/bin/sh
# Builds lib@NAME@_plugin.so against the MuJoCo of a Python environment: sh @NAME@_build.sh [python]
set -e
cd "$(dirname "$0")"
mujoco=$("${1:-python3}" -c 'import mujoco, os; print(os.path.dirname(mujoco.__file__))')
${CC:-cc} -O2 -fPIC -c @NAME@.c -o @NAME@.o
${CXX:-c++} -std=c++17 -O2 -shared -fPIC -I"$mujoco/include" @NAME@_plugin.cc @NAME@.o \
    "$mujoco"/libmujoco.so.* -Wl,-rpath,"$mujoco" -o lib@NAME@_plugin.so
echo "$PWD/lib@NAME@_plugin.so"
