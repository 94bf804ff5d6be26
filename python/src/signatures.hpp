#pragma once

/// Parts of signatures, which nanobind takes as literals.
// NOLINTBEGIN(cppcoreguidelines-macro-usage)

#define ARRAY(type) "numpy.typing.NDArray[numpy." type "]"
#define BOXES "numpy.typing.ArrayLike | tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike]"

/// What all queries have.
#define LIMITS                                                                                 \
  "limit: int | None = None, except_: numpy.typing.ArrayLike | None = None, most_hits: int = " \
  "2147483648, count_only: bool = False"
/// And those of a BroadPhase.
#define FILTERS                                                                                     \
  "group: numpy.typing.ArrayLike | None = None, mask: numpy.typing.ArrayLike | None = None, body: " \
  "numpy.typing.ArrayLike | None = None, world: numpy.typing.ArrayLike | None = None"
#define HITS "tuple[" ARRAY("uint64") ", " ARRAY("uint32") "]"
#define RANKED_HITS "tuple[" ARRAY("uint64") ", " ARRAY("uint32") ", " ARRAY("float64") "]"

// NOLINTEND(cppcoreguidelines-macro-usage)
