/* plugin_host PLUGIN: unloads the plug-in, and then outlives the threads that it has started. */
#include <dlfcn.h>
#include <stdio.h>
#include <unistd.h>

int main(int argc, char** argv) {
  void* plugin = dlopen(argc > 1 ? argv[1] : "", RTLD_NOW | RTLD_LOCAL);
  int (*find_pairs)(void) = NULL;
  if (plugin != NULL) *(void**)&find_pairs = dlsym(plugin, "find_pairs");
  if (find_pairs == NULL) {
    fprintf(stderr, "%s\n", dlerror());
    return 1;
  }
  if (find_pairs() != 0 || dlclose(plugin) != 0) return 1;
  sleep(11); /* idle threads end after ten seconds */
  printf("unloaded\n");
  return 0;
}
