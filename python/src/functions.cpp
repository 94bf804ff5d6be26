#include "functions.hpp"

#include <nanobind/stl/string.h>
#include <structmember.h>

#include <array>
#include <cstddef>
#include <new>
#include <string>

namespace nb = nanobind;

namespace broadcl::python {
namespace {

/// A function of nanobind with what Python's own have.
struct Function {
  PyObject base;
  vectorcallfunc vectorcall;
  PyObject* wrapped;
  PyObject* module;
};

Function& of(PyObject* self) {
  return *reinterpret_cast<Function*>(self);
}

PyObject* call(PyObject* self, PyObject* const* arguments, std::size_t count, PyObject* keywords) {
  return PyObject_Vectorcall(of(self).wrapped, arguments, count, keywords);
}

/// Does something in a slot of Python.
template <class Make>
PyObject* or_raise(const Make& make) noexcept {
  try {
    return nb::object(make()).release().ptr();
  } catch (nb::python_error& error) {
    error.restore();
    return nullptr;
  } catch (const std::bad_alloc&) {
    return PyErr_NoMemory();
  }
}

PyObject* bind(PyObject* self, PyObject* object, PyObject* /*type*/) {
  if (object == nullptr) return Py_NewRef(self);
  return or_raise(
      [&] { return nb::module_::import_("types").attr("MethodType")(nb::handle(self), nb::handle(object)); });
}

PyObject* attribute(PyObject* self, void* name) {
  return PyObject_GetAttrString(of(self).wrapped, static_cast<const char*>(name));
}

PyObject* module_of(PyObject* self, void* /*closure*/) {
  return Py_NewRef(of(self).module);
}

PyObject* signature_of(PyObject* self, void* /*closure*/) {
  return or_raise([&] {
    const nb::handle wrapped = of(self).wrapped;
    const auto text = nb::cast<std::string>(wrapped.attr("__nb_signature__")[0][0]);
    nb::dict names;
    nb::module_::import_("builtins")
        .attr("exec")("from __future__ import annotations\n" + text + ": ...", names);
    return nb::module_::import_("inspect").attr("signature")(names[wrapped.attr("__name__")]);
  });
}

/// That of `__init__`, without `self`. (Python 3.11.2 does not find it by itself, 3.11.7 does.)
PyObject* signature_of_class(PyObject* /*self*/, PyObject* /*object*/, PyObject* type) {
  return or_raise([&] {
    const nb::object signature = nb::handle(type).attr("__init__").attr("__signature__");
    nb::list parameters(signature.attr("parameters").attr("values")());
    parameters.attr("pop")(0);
    return signature.attr("replace")(nb::arg("parameters") = parameters);
  });
}

void destroy(PyObject* self) {
  PyTypeObject* type = Py_TYPE(self);
  Py_DECREF(of(self).wrapped);
  Py_DECREF(of(self).module);
  PyObject_Free(self);
  Py_DECREF(type);
}

nb::object made_of(PyType_Spec& spec) {
  nb::object type = nb::steal(PyType_FromSpec(&spec));
  if (!type.is_valid()) throw nb::python_error();
  return type;
}

nb::object make_type() {
  static std::array members{
      PyMemberDef{"__vectorcalloffset__", T_PYSSIZET, offsetof(Function, vectorcall), READONLY, nullptr},
      PyMemberDef{}};
  static std::array attributes{
      PyGetSetDef{"__module__", module_of, nullptr, nullptr, nullptr},
      PyGetSetDef{"__signature__", signature_of, nullptr, nullptr, nullptr},
      PyGetSetDef{"__name__", attribute, nullptr, nullptr, const_cast<char*>("__name__")},
      PyGetSetDef{"__qualname__", attribute, nullptr, nullptr, const_cast<char*>("__qualname__")},
      PyGetSetDef{"__doc__", attribute, nullptr, nullptr, const_cast<char*>("__doc__")},
      PyGetSetDef{}};
  std::array slots{PyType_Slot{Py_tp_members, members.data()},
                   PyType_Slot{Py_tp_getset, attributes.data()},
                   PyType_Slot{Py_tp_call, reinterpret_cast<void*>(PyVectorcall_Call)},
                   PyType_Slot{Py_tp_descr_get, reinterpret_cast<void*>(bind)},
                   PyType_Slot{Py_tp_dealloc, reinterpret_cast<void*>(destroy)},
                   PyType_Slot{}};
  PyType_Spec spec{"broadcl.function", sizeof(Function), 0,
                   Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_METHOD_DESCRIPTOR |
                       Py_TPFLAGS_DISALLOW_INSTANTIATION,
                   slots.data()};
  return made_of(spec);
}

nb::object make_class_signature() {
  std::array slots{PyType_Slot{Py_tp_descr_get, reinterpret_cast<void*>(signature_of_class)}, PyType_Slot{}};
  PyType_Spec spec{"broadcl.class_signature", sizeof(PyObject), 0, Py_TPFLAGS_DEFAULT, slots.data()};
  return made_of(spec)();
}

}  // namespace

void publish(nb::module_& module) {
  const auto name = nb::cast<std::string>(module.attr("__name__"));
  const std::size_t dot = name.rfind('.');
  if (dot == std::string::npos) return;
  const nb::str package(name.c_str(), dot);
  const nb::object type = make_type();
  const nb::object class_signature = make_class_signature();
  const auto is_of_nanobind = [](nb::handle value) { return nb::hasattr(value, "__nb_signature__"); };
  const auto wrap = [&](nb::handle owner, nb::handle key, nb::handle function) {
    auto* made = PyObject_New(Function, reinterpret_cast<PyTypeObject*>(type.ptr()));
    if (made == nullptr) throw nb::python_error();
    made->vectorcall = call;
    made->wrapped = Py_NewRef(function.ptr());
    made->module = Py_NewRef(package.ptr());
    nb::setattr(owner, key, nb::steal(reinterpret_cast<PyObject*>(made)));
  };
  for (const nb::handle entry : nb::list(module.attr("__dict__").attr("items")())) {
    const nb::object key = entry[0];
    const nb::object value = entry[1];
    if (!nb::isinstance<nb::type_object>(value)) {
      if (is_of_nanobind(value)) wrap(module, key, value);
      continue;
    }
    value.attr("__module__") = package;
    for (const nb::handle member : nb::list(value.attr("__dict__").attr("items")())) {
      const auto method = nb::cast<std::string>(member[0]);
      const bool is_public = method.front() != '_' || method == "__init__";
      if (!is_public || !is_of_nanobind(member[1])) continue;
      wrap(value, member[0], member[1]);
      if (method == "__init__") value.attr("__signature__") = class_signature;
    }
  }
}

}  // namespace broadcl::python
