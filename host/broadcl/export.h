#ifndef BROADCL_EXPORT_H
#define BROADCL_EXPORT_H

/* Marks what the libraries export: the core (BROADCL_API), the adapter (BROADCL_BULLET_API) and the MPI
   component (BROADCL_MPI_API); everything else is hidden. On Windows, BROADCL_SHARED is defined when shared
   libraries are built or used. */
#if defined(_WIN32) && defined(BROADCL_SHARED)
#define BROADCL_EXPORTED __declspec(dllexport)
#define BROADCL_IMPORTED __declspec(dllimport)
#elif !defined(_WIN32) && defined(__GNUC__)
#define BROADCL_EXPORTED __attribute__((visibility("default")))
#define BROADCL_IMPORTED BROADCL_EXPORTED
#else
#define BROADCL_EXPORTED
#define BROADCL_IMPORTED
#endif

#ifdef broadcl_EXPORTS
#define BROADCL_API BROADCL_EXPORTED
#else
#define BROADCL_API BROADCL_IMPORTED
#endif
#if defined(broadcl_bullet_EXPORTS) || defined(broadcl_bullet_float64_EXPORTS)
#define BROADCL_BULLET_API BROADCL_EXPORTED
#else
#define BROADCL_BULLET_API BROADCL_IMPORTED
#endif
#ifdef broadcl_mpi_EXPORTS
#define BROADCL_MPI_API BROADCL_EXPORTED
#else
#define BROADCL_MPI_API BROADCL_IMPORTED
#endif

#endif
