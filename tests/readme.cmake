# cmake -D SOURCE=source-tree -P readme.cmake: the first program in README.md is examples/first.cpp, which consume.cmake runs.
file(READ ${SOURCE}/README.md readme)
file(READ ${SOURCE}/examples/first.cpp program)
string(FIND "${readme}" "```cpp\n${program}```\n" position)
if(position EQUAL -1)
  message(SEND_ERROR "README.md lacks the text of examples/first.cpp")
endif()
