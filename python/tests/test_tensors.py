"""Tensors of CUDA: on a GPU if there is one, otherwise on PoCL with a library that pretends to be CUDA's driver."""

import ctypes
import os
import re
import subprocess
import sys
from pathlib import Path

tests = Path(__file__).parent


def has_gpu():
    try:
        return ctypes.CDLL("libcuda.so.1").cuInit(0) == 0
    except OSError:
        return False


def pretend(folder):
    library = folder / "libcuda.so.1"
    warnings = "-Wall", "-Wextra", "-Werror"
    options = "-std=c++20", *warnings, "-shared", "-fPIC", "-pthread", f"-Wl,-soname,{library.name}"
    subprocess.run(["c++", *options, "-o", library, tests / "pretended_cuda.cpp"], check=True)
    return {
        "LD_LIBRARY_PATH": str(folder), "OPENCL_LAYERS": str(library), "OCL_ICD_VENDORS": "/etc/OpenCL/vendors/pocl.icd",
        "POCL_DEVICES": "basic basic", "BROADCL_DEVICE": "", "PRETENDED_CUDA": "without faults",
    }


def test_in_a_process_with_cuda(tmp_path):
    environment = {} if has_gpu() else pretend(tmp_path)
    cases = [tests / "cuda_cases.py"] + [tests / "tensor_library_cases.py"] * has_gpu()
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *cases],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env={**os.environ, **environment},
    )
    assert run.returncode == 0, run.stdout
    assert not environment or re.search(r"^\d+ passed in ", run.stdout, re.MULTILINE), run.stdout  # none was skipped
