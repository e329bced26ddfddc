#!/bin/sh
# Checks what `make setup` needs of the machine; says in one sentence what is missing and how to get it on Debian or
# Ubuntu, and exits with 1. Usage: check_prerequisites.sh PYTHON

python=${1:-python3}
missing=""
packages=""

lacks() { # what, Debian packages
    missing="${missing:+$missing, }$1"
    packages="${packages:+$packages }$2"
}

if [ "$(uname -s) $(uname -m)" != "Linux x86_64" ]; then
    echo "make setup needs Linux on x86-64, since the ROS 2 wheels exist for nothing else (this is $(uname -s) $(uname -m)): build with colcon in a sourced ROS 2 Jazzy instead." >&2
    exit 1
fi

if ! command -v "$python" >/dev/null 2>&1; then
    lacks "Python 3.10 to 3.13 ($python is not there)" "python3 python3-venv python3-dev"
elif ! "$python" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] < (3, 14))' 2>/dev/null; then
    version=$("$python" -c 'import platform; print(platform.python_version())' 2>/dev/null || echo "not a Python that runs")
    echo "Missing: Python 3.10 to 3.13 ($python is $version); on Debian or Ubuntu: sudo apt install python3.X python3.X-venv python3.X-dev, where X is 10 on Ubuntu 22.04, 12 on Ubuntu 24.04, 11 on Debian 12 and 13 on Debian 13, then make PYTHON=python3.X." >&2
    exit 1
else
    name=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
    "$python" -c 'import venv, ensurepip' 2>/dev/null || lacks "the venv module of $name" "$name-venv"
    "$python" -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' \
        || lacks "the headers of $name (Python.h)" "$name-dev"
fi
command -v gcc >/dev/null 2>&1 || lacks "gcc" "gcc"
command -v g++ >/dev/null 2>&1 || lacks "g++" "g++"
command -v make >/dev/null 2>&1 || lacks "make" "make"

if [ -n "$missing" ]; then
    echo "Missing: $missing; on Debian or Ubuntu: sudo apt install $packages." >&2
    exit 1
fi
