# Stands in for CMake's module, which catkin asks for and which needs a compiler.
set(Threads_FOUND TRUE)
set(CMAKE_THREAD_LIBS_INIT "")
