#ifndef BROADCL_BROADCL_H
#define BROADCL_BROADCL_H

/// BroadCL for C (C99 or later) and for languages that can call C. This is the only interface with a stable
/// ABI: a program runs with every later library of the same SONAME.
///
/// These rules hold for all of it:
/// - Every function except broadcl_last_error() and broadcl_version() returns a status. After any status
///   other than BROADCL_SUCCESS nothing has changed, unless the comment of the function says otherwise, and
///   output parameters are not written to; the call may be repeated.
/// - Structs that begin with `size` may grow in later versions. Set the whole struct to zero and `size` to
///   sizeof, as in `broadcl_config config = {.size = sizeof config};`. Zero always means the default.
/// - Handles are made by functions with `_create` in their names, and by broadcl_broad_phase_overlapping(),
///   _nearest() and _along(). They belong to the caller, who destroys them with the matching `_destroy`.
///   Everything else that is returned belongs to the object that returned it.
/// - An object may be used by only one thread at a time, except by these three; different objects are
///   independent of each other. Functions that take no handle may be called by any number of threads at the
///   same time. Some functions read environment variables, so no thread may set one at the same time.
/// - Pairs are in canonical order (see struct broadcl_pair), unless they are sorted by world.

#include <stddef.h>
#include <stdint.h>

#include <broadcl/export.h>
#include <broadcl/version.h>

#ifdef __cplusplus
extern "C" {
#endif

/// The result of a call.
typedef enum broadcl_status {
  BROADCL_SUCCESS = 0,
  /// An argument cannot be used: for instance a null pointer, an unknown id, a NaN bound, a misaligned array
  /// or a struct with a wrong size.
  BROADCL_INVALID_ARGUMENT = 1,
  BROADCL_FAILED = 2,         ///< Anything else that broadcl_last_error() describes.
  BROADCL_OUT_OF_MEMORY = 3,  ///< Memory of the host is exhausted.
  /// OpenCL has too little memory. The object can be used with fewer boxes or pairs.
  BROADCL_OUT_OF_DEVICE_MEMORY = 4,
  /// The device may be lost: create a new object. (Some drivers report exhausted memory in the same way.)
  BROADCL_DEVICE_LOST = 5
} broadcl_status;

/// Describes the last failure in this thread, and what to do about it; "" if there was none. Valid until the
/// next call of the library in this thread.
BROADCL_API const char* broadcl_last_error(void);

/// BROADCL_VERSION_NUMBER of the library, which may be later than this header.
BROADCL_API uint32_t broadcl_version(void);

// --- Boxes and pairs

/// An axis-aligned box. Boxes are closed, so boxes that only touch overlap. Bounds may be infinite. A box
/// whose lower bound exceeds its upper bound on some axis is empty and overlaps nothing.
typedef struct broadcl_aabb {
  float lower[3];
  float upper[3];
} broadcl_aabb;

/// The same in double precision.
typedef struct broadcl_aabb64 {
  double lower[3];
  double upper[3];
} broadcl_aabb64;

/// Two overlapping boxes by id or by index; a < b, except in pairs of two sets. Canonical order is by b, then
/// by a.
typedef struct broadcl_pair {
  uint32_t a;
  uint32_t b;
} broadcl_pair;

/// A list of pairs that belongs to the object that returned it.
typedef struct broadcl_pairs {
  const broadcl_pair* data;
  size_t count;
} broadcl_pairs;

/// What changed between two updates. Apply `removed` first: an id may have been reused in between.
typedef struct broadcl_delta {
  broadcl_pairs added;
  broadcl_pairs removed;
} broadcl_delta;

/// Value of broadcl_filter.body: the object belongs to no body.
#define BROADCL_NO_BODY UINT32_C(0xffffffff)
/// Value of broadcl_filter.world: the object is in all worlds.
#define BROADCL_ALL_WORLDS UINT32_C(0xffffffff)

/// Decides, besides the boxes, whether two objects pair. They do if each is in a group of the other's mask,
/// if they are in the same world or one of them is in all worlds, and if they are not of the same body.
typedef struct broadcl_filter {
  uint32_t group;  ///< One bit per group that the object is in.
  uint32_t mask;   ///< One bit per group that the object pairs with.
  uint32_t body;   ///< Objects of the same body never pair.
  uint32_t world;  ///< Objects of different worlds never pair.
} broadcl_filter;

/// The default filter, with which everything pairs, as an initialiser.
#define BROADCL_DEFAULT_FILTER \
  { 1, UINT32_C(0xffffffff), BROADCL_NO_BODY, 0 }

/// Filters for two sets, as initialisers: only pairs of one object of each set are found. The first set is
/// the group of bit 0, of value 1; the second one is that of bit 1, of value 2. Each pairs with the other
/// only.
#define BROADCL_FIRST_SET \
  { 1, 2, BROADCL_NO_BODY, 0 }
#define BROADCL_SECOND_SET \
  { 2, 1, BROADCL_NO_BODY, 0 }

typedef enum broadcl_type { BROADCL_FLOAT32 = 0, BROADCL_FLOAT64 = 1 } broadcl_type;

/// Boxes in the caller's memory. They are only read, and only during the call.
typedef struct broadcl_boxes {
  size_t size;  ///< sizeof(broadcl_boxes)
  /// Lower x, y, z, upper x, y, z of the first box; in two dimensions lower x, y, upper x, y. May be null if
  /// there are no boxes.
  const void* data;
  size_t count;      ///< Number of boxes.
  ptrdiff_t stride;  ///< Bytes from each box to the next, a multiple of the numbers' size; 0 if without gaps.
  /// broadcl_type of the numbers. broadcl_pair_list_create(), and a broadcl_broad_phase with
  /// broadcl_config.type, find the pairs of float64 boxes exactly; everything else rounds them outward to
  /// float32, so that its pairs are a superset.
  int32_t type;
  uint32_t dimensions;  ///< 2 or 3; 0 means 3. Boxes in two dimensions extend from 0 to 0 in z.
} broadcl_boxes;

// --- Devices and algorithms

typedef enum broadcl_device_type {
  BROADCL_GPU = 0,
  BROADCL_CPU = 1,
  BROADCL_ACCELERATOR = 2,
  BROADCL_OTHER_DEVICE = 3
} broadcl_device_type;

/// What an OpenCL device reports about itself.
typedef struct broadcl_device_info {
  size_t size;        ///< sizeof(broadcl_device_info)
  const char* id;     ///< "P:D", platform and device as `clinfo -l` numbers them.
  const char* label;  ///< "platform / device".
  const char* platform_name;
  const char* name;
  const char* version;  ///< For instance "OpenCL 3.0 CUDA".
  const char* driver_version;
  int32_t type;  ///< broadcl_device_type.
  uint32_t compute_units;
  uint32_t clock_mhz;       ///< Highest clock frequency, 0 if the device does not say.
  uint32_t vendor_id;       ///< 0x10de for NVIDIA, for instance.
  uint64_t memory;          ///< Global memory, bytes.
  uint64_t max_allocation;  ///< Largest single buffer, bytes.
  int host_unified;         ///< Whether host and device share memory.
} broadcl_device_info;

/// The devices of this machine when the list was made.
typedef struct broadcl_device_list broadcl_device_list;

/// Lists every usable device of every OpenCL platform, in the order of `clinfo -l`. There may be none.
BROADCL_API broadcl_status broadcl_device_list_create(broadcl_device_list** list);
/// No-op for null.
BROADCL_API broadcl_status broadcl_device_list_destroy(broadcl_device_list* list);
BROADCL_API broadcl_status broadcl_device_list_size(const broadcl_device_list* list, size_t* size);
/// @param info Its strings belong to the list.
BROADCL_API broadcl_status broadcl_device_list_get(const broadcl_device_list* list, size_t index,
                                                   broadcl_device_info* info);
/// How many platforms and devices cannot be used.
BROADCL_API broadcl_status broadcl_device_list_failure_count(const broadcl_device_list* list, size_t* count);
/// One line that says which platform or device cannot be used, and why. It belongs to the list.
BROADCL_API broadcl_status broadcl_device_list_failure(const broadcl_device_list* list, size_t index,
                                                       const char** line);
/// The index of the device that a selector chooses: see broadcl_config.device.
/// @returns BROADCL_FAILED if none matches; the error lists the devices.
BROADCL_API broadcl_status broadcl_device_list_select(const broadcl_device_list* list, const char* selector,
                                                      size_t* index);

/// A row of the table of algorithms.
typedef struct broadcl_algorithm {
  const char* name;     ///< The value for broadcl_config.algorithm.
  const char* summary;  ///< One line for people.
  int on_device;        ///< 0 for an algorithm of the host; "auto" may use either.
} broadcl_algorithm;

/// All algorithms. The rows are constant and always valid.
BROADCL_API broadcl_status broadcl_algorithms(const broadcl_algorithm** rows, size_t* count);

/// Called once by an object that has to compile kernels, before it does so, because that may take many
/// seconds; a second time if the device turns out to need other kernels, for smaller work-groups. With
/// "auto", it may be called in another thread. Must return.
/// @param device Valid during the call, like `cache_folder`.
/// @param cache_folder Where the kernels are stored for the next start; "" if they cannot be stored.
typedef void (*broadcl_compile_handler)(const broadcl_device_info* device, const char* cache_folder,
                                        void* data);

/// Gives a task to threads of the application, which must call run(task) exactly once, in any thread: before
/// this returns, later, or at the same time as others. It must not wait for the task, nor do anything else
/// meanwhile that uses the same object. Called by the threads that work for the object, several at the same
/// time if several query it.
///
/// Nothing waits for a task that was not called: the thread that called the library does what nobody else
/// does. So a call may itself be a task of the same threads. A task that is called too late, perhaps after
/// the object was destroyed, returns at once. Of one that is never called, some bytes are never freed.
typedef void (*broadcl_executor)(void (*run)(void* task), void* task, void* data);

/// How an object works. Read once, when the object is made.
typedef struct broadcl_config {
  size_t size;  ///< sizeof(broadcl_config)
  /// "P:D" as numbered by `clinfo -l`; "gpu", "cpu" or "accelerator"; or a part of "platform / device",
  /// ignoring case. If it is null or empty, the environment variable BROADCL_DEVICE is used instead; if that
  /// is not set either, the best GPU, otherwise the best CPU, otherwise the first device. "auto" starts on
  /// the host and opens a GPU later; it uses a CPU only if that is named.
  const char* device;
  const char* algorithm;  ///< A name of broadcl_algorithms(); null for "auto".
  /// Threads that may work at the same time for a call, including the caller's; 0 for one per processor, of
  /// those that the process may use: on Linux, by its affinity and its control groups.
  size_t threads;
  int profile;                         ///< Whether to measure stages on the device, too.
  broadcl_compile_handler on_compile;  ///< May be null.
  void* on_compile_data;               ///< Passed to it.
  /// broadcl_type of the boxes of a broadcl_broad_phase; other objects ignore it. With BROADCL_FLOAT64, its
  /// pairs and changes are exactly those of boxes in double precision, however near or far their bounds: give
  /// them as broadcl_boxes, and use broadcl_broad_phase_map64() and broadcl_broad_phase_box64(). Takes 48 to
  /// 96 bytes more per box on the host.
  int32_t type;
  /// How far apart the boxes of a pair may be. It is as if each object had half of this as its reach:
  /// see broadcl_broad_phase_set_reach(), which is then refused.
  double distance;
  /// If it is not null, its threads do what threads of this library would do otherwise, and this library
  /// starts none but that in which "auto" opens a GPU. Set `threads` to their number, including the caller's.
  broadcl_executor executor;
  void* executor_data;  ///< Passed to it.
} broadcl_config;

/// OpenCL memory that an object holds, in bytes. Buffers grow with boxes and pairs; most never shrink.
typedef struct broadcl_memory_use {
  size_t size;         ///< sizeof(broadcl_memory_use)
  size_t device;       ///< On the device, now.
  size_t device_peak;  ///< The largest value of `device` so far.
  size_t pinned;       ///< Pinned memory of the host: for transfers, or accessed by kernels.
} broadcl_memory_use;

/// One stage of an update. The clocks of host and device cannot be compared.
typedef struct broadcl_stage {
  const char* name;       ///< Always valid. May occur several times in an update.
  double host_start;      ///< Seconds from the beginning of the update.
  double host_seconds;    ///< Wall-clock time of the calling thread in this stage, including waits.
  double device_start;    ///< Seconds from the start of the update's first command.
  double device_seconds;  ///< Both are 0 for host stages and without broadcl_config.profile.
} broadcl_stage;

// --- All pairs of a set of boxes, once

/// A list of pairs that belongs to the caller.
typedef struct broadcl_pair_list broadcl_pair_list;

/// Finds all overlapping pairs of boxes, by index, except those that are excluded. By default the host does
/// the search, unless a CPU is named as the device. A device stays open for later calls, but its memory is
/// freed, so for frequent searches keep a broadcl_broad_phase.
/// @param second Null for the pairs of one set. Otherwise a second set: each pair has a box of each, `a` is
/// an index in `boxes`, `b` in `second`, so `a` may be greater, and nothing is tested inside a set. (For two
/// sets that move, keep a broadcl_broad_phase with the filters BROADCL_FIRST_SET and BROADCL_SECOND_SET.)
/// @param exclusions `count` pairs of indices that are not reported, in any order; for one set also with a >
/// b. May be null if `count` is 0.
/// @param config May be null.
/// @returns BROADCL_INVALID_ARGUMENT also for a NaN bound, of which the error names the first box, and for an
/// exclusion of a box and itself, or of a box that does not exist.
BROADCL_API broadcl_status broadcl_pair_list_create(const broadcl_boxes* boxes, const broadcl_boxes* second,
                                                    const broadcl_pair* exclusions, size_t count,
                                                    const broadcl_config* config, broadcl_pair_list** list);
/// All pairs of objects that have a label in common, as exclusions. If the objects are the edges or faces of
/// a mesh, their labels are the numbers of their vertices.
/// @param labels `per_object` labels of object 0, then as many of object 1, and so on; `count` in all. May be
/// null if there are none.
/// @param second_labels The same of a second set: each pair then has an object of each set. If these are the
/// faces and the vertices of a mesh, a face has three labels and a vertex has one, its number.
/// @param per_second 0 for the pairs of one set.
/// @returns BROADCL_INVALID_ARGUMENT if a count is not a multiple of the number per object.
BROADCL_API broadcl_status broadcl_pair_list_create_sharing(const uint32_t* labels, size_t count,
                                                            size_t per_object, const uint32_t* second_labels,
                                                            size_t second_count, size_t per_second,
                                                            broadcl_pair_list** list);
/// No-op for null.
BROADCL_API broadcl_status broadcl_pair_list_destroy(broadcl_pair_list* list);
/// @param pairs Valid until the list is destroyed.
BROADCL_API broadcl_status broadcl_pair_list_pairs(const broadcl_pair_list* list, broadcl_pairs* pairs);

// --- What is where

/// What queries find, and how much of it is returned.
typedef struct broadcl_query_options {
  size_t size;  ///< sizeof(broadcl_query_options)
  /// With which filters the queries ask: one for all or one for each; null if none is to be tested.
  const broadcl_filter* filters;
  size_t filter_count;
  const uint32_t* except;  ///< Null, or for each query the id of an object that it does not find.
  size_t except_count;
  uint64_t most_hits;  ///< If queries find more in all, the call fails; 0 for 2^31.
  double within;       ///< The reach with which the queries ask, which adds to those of objects. Functions
                       ///< with `nearest` find what is at most so far away; 0 for any distance.
  uint32_t limit;      ///< How many objects each query finds at most: those with the lowest ids, or the
                       ///< first ones of functions with `nearest` and `along`; 0 for all.
  int count_only;      ///< Whether only the offsets are wanted.
} broadcl_query_options;

/// What queries found: query k the ids from offsets[k] to offsets[k + 1], in ascending order, or in that of
/// distances or times.
typedef struct broadcl_hits {
  const uint64_t* offsets;  ///< One more than queries.
  size_t query_count;
  const uint32_t* ids;              ///< Null if they were only counted.
  const double* squared_distances;  ///< One for each id, if a function with `nearest` made the list.
  const double* times;              ///< One for each id, if a function with `along` made the list.
} broadcl_hits;

/// What a batch of queries found. It belongs to the caller.
typedef struct broadcl_hit_list broadcl_hit_list;

/// Of each query the indices of the boxes that overlap or touch it, or are near it. For frequent queries keep
/// a broadcl_broad_phase, and call broadcl_broad_phase_overlapping(), which has the same arguments and
/// errors.
/// @param queries A box for each; points are boxes of no size. Exact if boxes or queries are float64.
/// @param options May be null, like `config`.
/// @returns BROADCL_INVALID_ARGUMENT also for a NaN bound, of which the error names the first box.
BROADCL_API broadcl_status broadcl_hit_list_create(const broadcl_boxes* boxes, const broadcl_boxes* queries,
                                                   const broadcl_query_options* options,
                                                   const broadcl_config* config, broadcl_hit_list** list);
/// Of each query the indices of the boxes that are nearest to it: as broadcl_broad_phase_nearest(), and
/// otherwise as broadcl_hit_list_create().
BROADCL_API broadcl_status broadcl_hit_list_create_nearest(const broadcl_boxes* boxes,
                                                           const broadcl_boxes* queries,
                                                           const broadcl_query_options* options,
                                                           const broadcl_config* config,
                                                           broadcl_hit_list** list);
/// Of each query the indices of the boxes that it meets on its way: as broadcl_broad_phase_along(), and
/// otherwise as broadcl_hit_list_create().
BROADCL_API broadcl_status broadcl_hit_list_create_along(
    const broadcl_boxes* boxes, const broadcl_boxes* starts, const double* directions, size_t direction_count,
    const double* lengths, size_t length_count, const broadcl_query_options* options,
    const broadcl_config* config, broadcl_hit_list** list);
/// No-op for null.
BROADCL_API broadcl_status broadcl_hit_list_destroy(broadcl_hit_list* list);
/// @param hits Valid until the list is destroyed.
BROADCL_API broadcl_status broadcl_hit_list_hits(const broadcl_hit_list* list, broadcl_hits* hits);

/// The squares of the distances of `count` pairs of boxes: of float64 boxes in float64, otherwise in float32;
/// infinite if a box is empty or has a NaN.
/// @param second Null for pairs of one set; otherwise `a` is an index in `boxes`, `b` in `second`.
/// @param config May be null. Only its threads matter.
BROADCL_API broadcl_status broadcl_squared_distances(const broadcl_boxes* boxes, const broadcl_boxes* second,
                                                     const broadcl_pair* pairs, size_t count,
                                                     const broadcl_config* config, double* distances);

// --- Moving boxes

/// A set of moving boxes that reports at each update which pairs began and which ceased to overlap. The
/// cost of an update depends on how much moved.
typedef struct broadcl_broad_phase broadcl_broad_phase;

/// Opens the device and builds its kernels, unless the algorithm starts on the host.
/// @param config May be null.
/// @returns BROADCL_INVALID_ARGUMENT for an unknown algorithm, BROADCL_FAILED if no device matches.
BROADCL_API broadcl_status broadcl_broad_phase_create(const broadcl_config* config,
                                                      broadcl_broad_phase** broad_phase);
/// No-op for null.
BROADCL_API broadcl_status broadcl_broad_phase_destroy(broadcl_broad_phase* broad_phase);

/// Adds an object for each box, as if one after the other; all or none. The id of each is the lowest free
/// one.
/// @param filters `filter_count` filters: as many as boxes, or one for all, or 0 for BROADCL_DEFAULT_FILTER.
/// @param ids For as many ids as boxes, in their order.
/// @returns BROADCL_INVALID_ARGUMENT also for a NaN bound, of which the error names the first box.
BROADCL_API broadcl_status broadcl_broad_phase_add(broadcl_broad_phase* broad_phase,
                                                   const broadcl_boxes* boxes, const broadcl_filter* filters,
                                                   size_t filter_count, uint32_t* ids);
/// Replaces the boxes of `count` objects, by several threads if there are many and the ids ascend; all or
/// none. If an id is given twice, the later box counts. An equal box does not count as movement.
/// @param boxes `count` boxes.
/// @returns BROADCL_INVALID_ARGUMENT also for an unknown id and for a NaN bound.
BROADCL_API broadcl_status broadcl_broad_phase_move(broadcl_broad_phase* broad_phase, const uint32_t* ids,
                                                    size_t count, const broadcl_boxes* boxes);
/// Replaces the filter of an object from the next update on.
/// @returns BROADCL_INVALID_ARGUMENT also for an unknown id.
BROADCL_API broadcl_status broadcl_broad_phase_set_filter(broadcl_broad_phase* broad_phase, uint32_t id,
                                                          const broadcl_filter* filter);
/// Replaces the filters of `count` objects; all or none. If an id is given twice, the later filter counts.
/// @param filters `filter_count` filters: as many as ids, or one for all.
/// @returns As above.
BROADCL_API broadcl_status broadcl_broad_phase_set_filters(broadcl_broad_phase* broad_phase,
                                                           const uint32_t* ids, size_t count,
                                                           const broadcl_filter* filters,
                                                           size_t filter_count);
/// Sets how far `count` objects reach beyond their boxes, initially 0; all or none. Two objects pair if the
/// Euclidean distance of their boxes is at most the sum of their reaches. (docs/distances.md has each step of
/// the arithmetic.) A reach that changes counts as movement.
/// @param reaches As many as ids, or one for all; rounded to float32 if the boxes are.
/// @returns BROADCL_INVALID_ARGUMENT also for an unknown id, for a reach that is negative, NaN or greater
/// than 2^62, and if there is a broadcl_config.distance.
BROADCL_API broadcl_status broadcl_broad_phase_set_reach(broadcl_broad_phase* broad_phase,
                                                         const uint32_t* ids, size_t count,
                                                         const double* reaches, size_t reach_count);
/// Removes `count` objects; all or none. Their pairs are in `removed` of the next update.
/// @returns BROADCL_INVALID_ARGUMENT also for an unknown id, and for one that is given twice.
BROADCL_API broadcl_status broadcl_broad_phase_remove(broadcl_broad_phase* broad_phase, const uint32_t* ids,
                                                      size_t count);

/// Whether an object has this id: 1 or 0.
BROADCL_API broadcl_status broadcl_broad_phase_contains(const broadcl_broad_phase* broad_phase, uint32_t id,
                                                        int* contains);
/// The box of an object, as it will be in the next update. An empty one may have other bounds than those that
/// were given.
/// @returns BROADCL_INVALID_ARGUMENT also for an unknown id, and if the boxes are float64.
BROADCL_API broadcl_status broadcl_broad_phase_box(const broadcl_broad_phase* broad_phase, uint32_t id,
                                                   broadcl_aabb* box);
/// The same if the boxes are float64.
/// @returns BROADCL_INVALID_ARGUMENT also for an unknown id, and if the boxes are float32.
BROADCL_API broadcl_status broadcl_broad_phase_box64(const broadcl_broad_phase* broad_phase, uint32_t id,
                                                     broadcl_aabb64* box);
/// Its filter.
/// @returns As above.
BROADCL_API broadcl_status broadcl_broad_phase_filter(const broadcl_broad_phase* broad_phase, uint32_t id,
                                                      broadcl_filter* filter);
/// Its reach; with a broadcl_config.distance, half of that.
/// @returns As above.
BROADCL_API broadcl_status broadcl_broad_phase_reach(const broadcl_broad_phase* broad_phase, uint32_t id,
                                                     double* reach);

/// The ids of all objects, in ascending order.
/// @param ids `count` ids, valid until the next call of this function, or shrink.
BROADCL_API broadcl_status broadcl_broad_phase_ids(broadcl_broad_phase* broad_phase, const uint32_t** ids,
                                                   size_t* count);
/// The boxes of all objects, in the order of their ids, each as broadcl_broad_phase_box() returns it.
/// @param boxes As above.
/// @returns BROADCL_INVALID_ARGUMENT also if the boxes are float64.
BROADCL_API broadcl_status broadcl_broad_phase_boxes(broadcl_broad_phase* broad_phase,
                                                     const broadcl_aabb** boxes, size_t* count);
/// The same if the boxes are float64.
/// @returns BROADCL_INVALID_ARGUMENT also if the boxes are float32.
BROADCL_API broadcl_status broadcl_broad_phase_boxes64(broadcl_broad_phase* broad_phase,
                                                       const broadcl_aabb64** boxes, size_t* count);
/// Their filters, in the same order.
/// @param filters As above.
BROADCL_API broadcl_status broadcl_broad_phase_filters(broadcl_broad_phase* broad_phase,
                                                       const broadcl_filter** filters, size_t* count);
/// Their reaches, in the same order.
/// @param reaches As above.
BROADCL_API broadcl_status broadcl_broad_phase_reaches(broadcl_broad_phase* broad_phase,
                                                       const double** reaches, size_t* count);
/// What broadcl_broad_phase_set_exclusions() was given last, in canonical order and each pair once.
/// @param pairs As above.
BROADCL_API broadcl_status broadcl_broad_phase_exclusions(broadcl_broad_phase* broad_phase,
                                                          broadcl_pairs* pairs);

/// Replaces the list of pairs of ids that are never reported, whatever their boxes and filters: for instance
/// joined bodies. A pair applies to whichever objects have the two ids. Initially the list is empty.
/// @param pairs In any order; copied. May be null if there are none.
/// @returns BROADCL_INVALID_ARGUMENT also for a pair of an id with itself.
BROADCL_API broadcl_status broadcl_broad_phase_set_exclusions(broadcl_broad_phase* broad_phase,
                                                              const broadcl_pair* pairs, size_t count);

/// Makes 0 .. count-1 the ids of the objects, by adding those that are missing, with empty boxes, and
/// removing all others, and returns the memory from which their boxes are read, for the caller to write. All
/// objects count as moved. If a box has a NaN bound, the next update returns BROADCL_INVALID_ARGUMENT.
/// @param boxes `count` boxes, valid until the next call with this object.
/// @returns BROADCL_FAILED also between begin and finish; BROADCL_INVALID_ARGUMENT also if the boxes are
/// float64.
BROADCL_API broadcl_status broadcl_broad_phase_map(broadcl_broad_phase* broad_phase, size_t count,
                                                   broadcl_aabb** boxes);
/// The same if the boxes are float64.
/// @returns BROADCL_FAILED also between begin and finish; BROADCL_INVALID_ARGUMENT also if the boxes are
/// float32.
BROADCL_API broadcl_status broadcl_broad_phase_map64(broadcl_broad_phase* broad_phase, size_t count,
                                                     broadcl_aabb64** boxes);

/// Finds every pair of overlapping boxes whose filters allow it, and returns what changed since the last
/// update. The same as begin and finish.
/// @param delta May be null. Valid until the next update, finish or shrink.
BROADCL_API broadcl_status broadcl_broad_phase_update(broadcl_broad_phase* broad_phase, broadcl_delta* delta);
/// The same with new boxes for all objects: box k becomes that of object k, missing objects are added, and
/// objects beyond the last box are removed. The ids are then 0 .. count-1; objects that existed keep their
/// filters. The boxes are in memory of the caller, in any layout. Boxes that are the same as before do not
/// count as movement. If this fails, objects, boxes and pairs are as before the call, which may be repeated.
/// @returns BROADCL_INVALID_ARGUMENT also for a NaN bound, of which the error names the first box;
/// BROADCL_FAILED also between begin and finish.
BROADCL_API broadcl_status broadcl_broad_phase_update_boxes(broadcl_broad_phase* broad_phase,
                                                            const broadcl_boxes* boxes, broadcl_delta* delta);
/// Starts such an update, which also removes objects beyond the last box, as begin does; the memory of the
/// boxes may be overwritten afterwards.
BROADCL_API broadcl_status broadcl_broad_phase_begin_boxes(broadcl_broad_phase* broad_phase,
                                                           const broadcl_boxes* boxes);
/// Starts an update on the device and returns at once. Changes that are made before finish belong to the next
/// update. No-op if an update was started already. If the host does the update, finish does all of the work.
BROADCL_API broadcl_status broadcl_broad_phase_begin(broadcl_broad_phase* broad_phase);
/// Waits for the update that begin started, or does one if none was started. If this fails, that update is
/// over.
/// @param delta As above.
BROADCL_API broadcl_status broadcl_broad_phase_finish(broadcl_broad_phase* broad_phase, broadcl_delta* delta);

/// Copies the objects for broadcl_broad_phase_restore(). Nothing is searched.
/// @param bytes Valid until the next call of this function. Only the same version of the library reads them.
/// @returns BROADCL_FAILED also between begin and finish, and with changes that no update has reported.
BROADCL_API broadcl_status broadcl_broad_phase_save(broadcl_broad_phase* broad_phase, const void** bytes,
                                                    size_t* size);
/// Makes objects, ids, filters, reaches, exclusions and pairs those of the moment of save, and drops changes
/// that no update has reported. The bytes may be those of another object with the same broadcl_config.type
/// and .distance.
/// @param delta As of an update. A pair that is there before and afterwards is not in it, even if its objects
/// were replaced meanwhile.
/// @returns BROADCL_INVALID_ARGUMENT also for other bytes; BROADCL_FAILED also between begin and finish.
BROADCL_API broadcl_status broadcl_broad_phase_restore(broadcl_broad_phase* broad_phase, const void* bytes,
                                                       size_t size, broadcl_delta* delta);

/// Gives back memory that the present objects and pairs do not need, on host and device, for instance after
/// an update with far more pairs than usual; nothing does so by itself. Lists that earlier calls returned
/// become invalid. Waits for the device.
/// @returns BROADCL_FAILED also between begin and finish.
BROADCL_API broadcl_status broadcl_broad_phase_shrink(broadcl_broad_phase* broad_phase);

/// All pairs as of the last update.
/// @param pairs Valid until the next call of this function, update, finish or shrink.
/// @returns BROADCL_FAILED also between begin and finish.
BROADCL_API broadcl_status broadcl_broad_phase_pairs(broadcl_broad_phase* broad_phase, broadcl_pairs* pairs);
/// The ids of the objects that are in a pair with this one, as of the last update, in ascending order. The
/// first call after an update passes once over the pairs.
/// @param ids Valid until the next call of this function, or shrink.
/// @returns BROADCL_INVALID_ARGUMENT also for an unknown id; BROADCL_FAILED also between begin and finish.
BROADCL_API broadcl_status broadcl_broad_phase_partners(broadcl_broad_phase* broad_phase, uint32_t id,
                                                        const uint32_t** ids, size_t* count);
/// Of each query the objects that overlap or touch it, or are near it, as their boxes are set now: no update
/// is needed, and none is done. An object that asks with its own box finds itself, unless it is excepted.
/// Several threads may call this at the same time, as long as none calls another function with this object.
BROADCL_API broadcl_status broadcl_broad_phase_overlapping(const broadcl_broad_phase* broad_phase,
                                                           const broadcl_boxes* boxes,
                                                           const broadcl_query_options* options,
                                                           broadcl_hit_list** list);
/// Of each query the `limit` objects with the least distance, and of those at the same distance the ones with
/// the lowest ids, in this order; without a limit all that are at most `within` away. Distances are those of
/// broadcl_squared_distances(), in the precision of the object's boxes; reaches do not matter. Otherwise as
/// broadcl_broad_phase_overlapping().
BROADCL_API broadcl_status broadcl_broad_phase_nearest(const broadcl_broad_phase* broad_phase,
                                                       const broadcl_boxes* boxes,
                                                       const broadcl_query_options* options,
                                                       broadcl_hit_list** list);
/// Of each query the first `limit` objects that it meets as it moves by t times its direction, for all t from
/// 0 to its length: in the order in which it does, and by id if at the same time. A ray is a box of no size.
/// What is met at the start has the time 0. BasicBroadPhase::along() of C++ has the definition. Reaches do
/// not matter. Otherwise as broadcl_broad_phase_overlapping().
/// @param starts Finite, or empty: those meet nothing.
/// @param directions x, y, z of `direction_count` directions: one for each start, or one for all. Finite;
/// rounded to float32, like `lengths`, unless the object's boxes are float64.
/// @param lengths `length_count` lengths, in multiples of the directions: one for each start, one for all, or
/// 0 for infinite ones.
/// @returns BROADCL_INVALID_ARGUMENT also for an infinite start, for a direction that is infinite or NaN, for
/// a length that is negative or NaN, and if `within` is given.
BROADCL_API broadcl_status broadcl_broad_phase_along(const broadcl_broad_phase* broad_phase,
                                                     const broadcl_boxes* starts, const double* directions,
                                                     size_t direction_count, const double* lengths,
                                                     size_t length_count,
                                                     const broadcl_query_options* options,
                                                     broadcl_hit_list** list);
/// The number of objects.
BROADCL_API broadcl_status broadcl_broad_phase_size(const broadcl_broad_phase* broad_phase, size_t* size);
/// The device that will do the next update.
/// @param info Its strings are valid until the next call with this object. If the host will do the update,
/// all members except `size` are 0.
BROADCL_API broadcl_status broadcl_broad_phase_device(broadcl_broad_phase* broad_phase,
                                                      broadcl_device_info* info);
/// The row of the algorithm in use.
BROADCL_API broadcl_status broadcl_broad_phase_algorithm(const broadcl_broad_phase* broad_phase,
                                                         const broadcl_algorithm** row);
BROADCL_API broadcl_status broadcl_broad_phase_memory(const broadcl_broad_phase* broad_phase,
                                                      broadcl_memory_use* use);
/// The stages of the last update, in order; none if nothing had moved, or if an algorithm of the host did it.
/// @param stages Valid until the next call with this object.
BROADCL_API broadcl_status broadcl_broad_phase_profile(broadcl_broad_phase* broad_phase,
                                                       const broadcl_stage** stages, size_t* count);

// --- Boxes that are on an OpenCL device already

struct _cl_command_queue;  // NOLINT(bugprone-reserved-identifier): cl_command_queue points to it
struct _cl_mem;            // NOLINT(bugprone-reserved-identifier): cl_mem points to it

/// Finds pairs of boxes in a cl_mem, in the caller's context and queue; only counts come to the host. Object
/// k is the box at index k, the same object in every update. Nothing else may use the queue during a call.
typedef struct broadcl_device_broad_phase broadcl_device_broad_phase;

typedef struct broadcl_device_config {
  size_t size;            ///< sizeof(broadcl_device_config)
  const char* algorithm;  ///< "auto", "brute-force" or "tiles"; null for "auto".
  int profile;            ///< Whether to measure on the device: the queue must have profiling enabled.
  broadcl_compile_handler on_compile;  ///< May be null.
  void* on_compile_data;               ///< Passed to it.
} broadcl_device_config;

/// Boxes in a buffer of the queue's context. They are only read, by commands that are enqueued during the
/// call. Empty boxes and those with a NaN bound overlap nothing.
typedef struct broadcl_device_boxes {
  size_t size;              ///< sizeof(broadcl_device_boxes)
  struct _cl_mem* buffer;   ///< float32: lower x, y, z, upper x, y, z of each box.
  size_t count;             ///< Number of boxes.
  size_t offset;            ///< Of the first box, in bytes, a multiple of 4.
  size_t stride;            ///< From each box to the next, in bytes, a multiple of 4; 0 if without gaps.
  struct _cl_mem* filters;  ///< One filter per box, also of the queue's context; or null: all may pair.
  /// Whether the filters have different worlds. Affects only speed: without it, worlds are compared only for
  /// pairs whose boxes overlap.
  int worlds;
  /// If not 0, changes are sorted by world first: 0 .. ordered_worlds-1, then all others. A pair with an
  /// object of all worlds counts as one of the other object's world; pairs of two such objects come last.
  size_t ordered_worlds;
  /// If not null, the boxes of a second set: only pairs of a box of the first with a box of the second are
  /// found; `a` is an index in the first set, `b` in the second. Filters are then those of the first set
  /// followed by those of the second; only their body and world count. Whether there is
  /// a second set, and then the number of boxes of the first, must be the same in every update: give empty
  /// boxes for objects that are gone. In the index of an invalid box, the second set follows the first.
  struct _cl_mem* second_buffer;
  size_t second_count;   ///< As `count`,
  size_t second_offset;  ///< `offset`
  size_t second_stride;  ///< and `stride`.
} broadcl_device_boxes;

/// Pairs on the device, in the layout of broadcl_pair. The buffer belongs to the broad phase and stays
/// unchanged until its next update; commands that are enqueued to the same queue afterwards find it filled.
typedef struct broadcl_pair_buffer {
  struct _cl_mem* buffer;
  size_t count;
  /// If pairs are sorted by world, ordered_worlds + 2 uint32: for each world the index at which its pairs
  /// begin, then the index at which all others begin, then the count. Otherwise null.
  struct _cl_mem* offsets;
} broadcl_pair_buffer;

/// What changed since the last update.
typedef struct broadcl_device_result {
  size_t size;  ///< sizeof(broadcl_device_result)
  broadcl_pair_buffer added;
  broadcl_pair_buffer removed;
  size_t pair_count;       ///< How many overlap now.
  size_t invalid_boxes;    ///< Boxes with a NaN bound.
  uint32_t first_invalid;  ///< The index of the first of these; 0 if there are none.
  /// How many enqueued updates since the last result are incomplete, because something did not fit. This
  /// result includes their changes.
  size_t incomplete;
} broadcl_device_result;

/// The caller's buffers, of the queue's context, for the changes of an enqueued update.
typedef struct broadcl_change_buffers {
  size_t size;              ///< sizeof(broadcl_change_buffers)
  struct _cl_mem* added;    ///< For `capacity` pairs.
  struct _cl_mem* removed;  ///< Likewise.
  size_t capacity;          ///< At least 1.
  /// For four uint32: the numbers of added pairs, of removed pairs, and of all pairs that overlap now; and 1
  /// if the update is incomplete, otherwise 0.
  struct _cl_mem* counts;
  struct _cl_mem* added_offsets;    ///< As broadcl_pair_buffer.offsets, if worlds are ordered.
  struct _cl_mem* removed_offsets;  ///< Likewise.
} broadcl_change_buffers;

/// @param queue A cl_command_queue, in order. Retained.
/// @param config May be null.
BROADCL_API broadcl_status broadcl_device_broad_phase_create(struct _cl_command_queue* queue,
                                                             const broadcl_device_config* config,
                                                             broadcl_device_broad_phase** broad_phase);
/// No-op for null. Does not wait. Wait for the queue before the process ends.
BROADCL_API broadcl_status broadcl_device_broad_phase_destroy(broadcl_device_broad_phase* broad_phase);

/// Finds every pair of overlapping boxes whose filters allow it; objects beyond the last box no longer exist.
/// The same as begin and finish; waits for the queue once.
/// @param result May be null.
BROADCL_API broadcl_status broadcl_device_broad_phase_update(broadcl_device_broad_phase* broad_phase,
                                                             const broadcl_device_boxes* boxes,
                                                             broadcl_device_result* result);
/// Enqueues an update and returns at once. (If enqueue did the last update, waits for that first.) Commands
/// enqueued to the same queue afterwards may overwrite boxes and filters. Fails if an update was begun
/// already.
BROADCL_API broadcl_status broadcl_device_broad_phase_begin(broadcl_device_broad_phase* broad_phase,
                                                            const broadcl_device_boxes* boxes);
/// Waits for the update that begin started; fails if there is none. If this fails, that update is over.
/// @param result May be null.
BROADCL_API broadcl_status broadcl_device_broad_phase_finish(broadcl_device_broad_phase* broad_phase,
                                                             broadcl_device_result* result);

/// Reserves memory for enqueued updates. If this fails, nothing may be reserved any more.
/// @param boxes Largest number of boxes.
/// @param pairs Largest number of pairs that overlap at a time.
/// @param filters Whether there will be filters or a second set.
BROADCL_API broadcl_status broadcl_device_broad_phase_reserve(broadcl_device_broad_phase* broad_phase,
                                                              size_t boxes, size_t pairs, int filters);
/// Gives back memory that the boxes and pairs of the last update do not need, and what reserve reserved: call
/// that again before enqueue. Buffers that earlier calls returned become invalid. Waits for the queue.
/// @returns BROADCL_FAILED also between begin and finish.
BROADCL_API broadcl_status broadcl_device_broad_phase_shrink(broadcl_device_broad_phase* broad_phase);
/// Replaces the list of pairs of indices that are never reported, whatever their boxes and filters. For these
/// indices, a second set follows the first. Initially the list is empty. Waits for the queue.
/// @param pairs In any order; copied. May be null if there are none.
/// @returns BROADCL_INVALID_ARGUMENT also for a pair of an index with itself; BROADCL_FAILED also between
/// begin and finish.
BROADCL_API broadcl_status broadcl_device_broad_phase_set_exclusions(broadcl_device_broad_phase* broad_phase,
                                                                     const broadcl_pair* pairs, size_t count);

/// Enqueues an update that writes its changes, in canonical order, to buffers of the caller, for commands
/// that are enqueued after it. Does not wait for the device, except after a call that failed. Memory must
/// have been reserved: for all boxes of both sets, for at least as many boxes as there are ordered worlds,
/// and with `filters` if there are filters or a second set.
///
/// If more pairs overlap than was reserved, if more changed than the buffers hold, or if more than 4,096
/// changes have the same b (or world, if changes are sorted by world), the update is incomplete: it and all
/// updates that are enqueued after it change nothing. The next waiting call continues from the last complete
/// update.
BROADCL_API broadcl_status broadcl_device_broad_phase_enqueue(broadcl_device_broad_phase* broad_phase,
                                                              const broadcl_device_boxes* boxes,
                                                              const broadcl_change_buffers* changes);

/// All pairs as of the last update: enqueues the commands that sort them.
/// @param pairs Valid until the next call with this object.
BROADCL_API broadcl_status broadcl_device_broad_phase_pairs(broadcl_device_broad_phase* broad_phase,
                                                            broadcl_pair_buffer* pairs);
/// @param info Its strings belong to the broad phase.
BROADCL_API broadcl_status broadcl_device_broad_phase_device(const broadcl_device_broad_phase* broad_phase,
                                                             broadcl_device_info* info);
/// Without the caller's buffers.
BROADCL_API broadcl_status broadcl_device_broad_phase_memory(const broadcl_device_broad_phase* broad_phase,
                                                             broadcl_memory_use* use);
/// As broadcl_broad_phase_profile(), with device times if the configuration asks for a profile and enqueue
/// did not do the last update.
BROADCL_API broadcl_status broadcl_device_broad_phase_profile(broadcl_device_broad_phase* broad_phase,
                                                              const broadcl_stage** stages, size_t* count);

#ifdef __cplusplus
}  // extern "C"
#endif

#endif
