"""Tensors in memory of CUDA and what reads them, with nothing but libcuda.so.1: NVIDIA's, or the pretended one."""

import contextlib
import ctypes
import math

import numpy as np

driver = ctypes.CDLL("libcuda.so.1")
LEGACY = 1  # the default stream
alive = {}  # what capsules refer to, by its address


def cuda(function, *arguments):
    status = getattr(driver, function)(*[ctypes.c_uint64(x) if isinstance(x, int) else x for x in arguments])
    if status:
        raise RuntimeError(f"{function} returned {status}")


def new(function, *arguments):
    result = ctypes.c_uint64()
    cuda(function, ctypes.byref(result), *arguments)
    return result.value


@contextlib.contextmanager
def current(device):
    cuda("cuCtxPushCurrent_v2", new("cuDevicePrimaryCtxRetain", device))
    try:
        yield
    finally:
        cuda("cuCtxPopCurrent_v2", None)


class Stream:
    def __init__(self, device=0):
        self.device = device
        with current(device):
            self.handle = new("cuStreamCreate", 1)  # does not wait for the default stream

    def __del__(self):
        with current(self.device):
            cuda("cuStreamDestroy_v2", self.handle)


def wait_for(device, first, second):
    """What follows in the second stream begins after what is in the first."""
    with current(device):
        event = new("cuEventCreate", 2)
        cuda("cuEventRecord", event, first)
        cuda("cuStreamWaitEvent", second, event, 0)
        cuda("cuEventDestroy_v2", event)


class Tensor:
    """The elements of a NumPy array, and of the one of which it is a view, written by a stream when that gets there.

    In memory of its own, or in that of a Consumer, from a row on."""

    def __init__(self, values, *, stream=None, device=0, inside=None, row=0):
        base = values if values.base is None else values.base
        self.shape, self.strides, self.dtype, self.size = values.shape, values.strides, values.dtype, base.nbytes
        self.offset, self.is_compact = values.ctypes.data - base.ctypes.data, values.flags.c_contiguous
        self.device, self.stream = device, stream
        self.handle = stream.handle if stream else LEGACY
        self.inside = inside
        if inside:
            self.memory = inside.address + row * values.strides[0]
        else:
            with current(device):
                self.memory = new("cuMemAlloc_v2", self.size + 1)
        self.write(base)

    def write(self, values):
        copy_later(self.device, self.memory, values.ctypes.data, self.size, self.handle)

    def __del__(self):
        if not self.inside:
            with current(self.device):
                cuda("cuMemFree_v2", self.memory)


def copy_later(device, to, source, size, stream):
    with current(device):
        cuda("cuMemcpyAsync", to, source, size, stream)


def read(address, shape, dtype, device=0, stream=LEGACY):
    """What a stream finds at an address."""
    values = np.empty(shape, dtype)
    copy_later(device, values.ctypes.data, address, values.nbytes, stream)
    with current(device):
        cuda("cuStreamSynchronize", stream)
    return values


class InterfaceTensor(Tensor):
    """Has only __cuda_array_interface__, with or without its stream."""

    names_stream = True

    @property
    def __cuda_array_interface__(self):
        return {
            "shape": self.shape, "typestr": self.dtype.str, "data": (self.memory + self.offset, False), "version": 3,
            "strides": None if self.is_compact else self.strides,
        } | ({"stream": self.handle} if self.names_stream else {})


class Layout(ctypes.Structure):
    """DLTensor"""

    _fields_ = [
        ("address", ctypes.c_void_p), ("kind", ctypes.c_int32), ("device", ctypes.c_int32), ("rank", ctypes.c_int32),
        ("code", ctypes.c_uint8), ("bits", ctypes.c_uint8), ("lanes", ctypes.c_uint16),
        ("shape", ctypes.POINTER(ctypes.c_int64)), ("strides", ctypes.POINTER(ctypes.c_int64)), ("offset", ctypes.c_uint64),
    ]


Deleter = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


class Managed(ctypes.Structure):
    """DLManagedTensor"""

    _fields_ = [("layout", Layout), ("context", ctypes.c_void_p), ("deleter", Deleter)]


def of_python(name, result, *arguments):
    return ctypes.PYFUNCTYPE(result, *arguments)((name, ctypes.pythonapi))


new_capsule = of_python("PyCapsule_New", ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
pointer_of = of_python("PyCapsule_GetPointer", ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)
rename = of_python("PyCapsule_SetName", ctypes.c_int, ctypes.py_object, ctypes.c_char_p)
FRESH, USED, EXCHANGE = b"dltensor", b"used_dltensor", b"dlpack_exchange_api"  # capsules refer to these names


@Deleter
def delete(managed):
    del alive[managed]


class DlpackTensor(Tensor):
    """Has only DLPack. (What takes no capsule that it has asked for leaks it.)"""

    kind = 2  # kDLCUDA

    def __dlpack_device__(self):
        return self.kind, self.device

    def __dlpack__(self, *, stream=None, max_version=None, dl_device=None, copy=None):
        if stream != -1:
            wait_for(self.device, self.handle, stream or LEGACY)
        numbers = ctypes.c_int64 * len(self.shape)
        shape, strides = numbers(*self.shape), numbers(*[stride // self.dtype.itemsize for stride in self.strides])
        number = "iuf".index(self.dtype.kind), self.dtype.itemsize * 8, 1
        layout = Layout(self.memory, self.kind, self.device, len(shape), *number, shape, None if self.is_compact else strides, self.offset)
        managed = Managed(layout, None, delete)
        alive[ctypes.addressof(managed)] = managed, shape, strides, self
        return new_capsule(ctypes.addressof(managed), FRESH, None)


class Exchange(ctypes.Structure):
    """DLPackExchangeAPI"""

    _fields_ = [
        ("major", ctypes.c_uint32), ("minor", ctypes.c_uint32), ("unused", ctypes.c_void_p * 5),
        ("current_stream", ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_int32, ctypes.POINTER(ctypes.c_void_p))),
    ]


class ExchangeTensor(DlpackTensor):
    """Also says in C, as PyTorch's do, which stream is current: that of the last one that was made."""

    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **named)
        ExchangeTensor.current = self.handle

    @Exchange._fields_[-1][1]
    def get_current(kind, device, stream):
        stream[0] = ExchangeTensor.current
        return 0

    exchange = Exchange(1, 2, (None,) * 5, get_current)
    __dlpack_c_exchange_api__ = new_capsule(ctypes.addressof(exchange), EXCHANGE, None)


class Consumer:
    """Shows an array that has DLPack until it is deleted."""

    def __init__(self, array, **arguments):
        capsule = array.__dlpack__(**arguments)
        self.managed = Managed.from_address(pointer_of(capsule, FRESH))
        rename(capsule, USED)
        layout = self.managed.layout
        self.device, self.shape = (layout.kind, layout.device), tuple(layout.shape[: layout.rank])
        self.dtype = np.dtype("iuf"[layout.code] + str(layout.bits // 8))
        self.address = (layout.address or 0) + layout.offset
        self.size = math.prod(self.shape) * self.dtype.itemsize

    def get(self):
        return read(self.address, self.shape, self.dtype, self.device[1])

    def __del__(self):
        if self.managed.deleter:
            self.managed.deleter(ctypes.addressof(self.managed))
