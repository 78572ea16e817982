# How all of ground is compiled, with ROS and without.
get_filename_component(ground_source_dir ${CMAKE_CURRENT_LIST_DIR}/.. ABSOLUTE)
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(ground_warnings -Wall -Wextra -Wshadow -Werror CACHE STRING "what the compiler has to say")
# Shells around the core do little at run time, but their headers take long to optimise.
set(ground_shell_options -O1)
