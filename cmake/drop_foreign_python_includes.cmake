# For building interfaces against the ROS wheels; a sourced ROS installation does not need it.
#
# Every <pkg>__rosidl_generator_py target of the wheels exports include directories below /opt/python/, which exist only
# on the machine where the wheels were built, and CMake refuses imported targets with missing include directories.
# Name this file in CMAKE_PROJECT_TOP_LEVEL_INCLUDES: at the end of the top-level CMakeLists.txt, before the generate
# step, it drops those directories from every imported target. No CMakeLists.txt has to change.

function(_drop_foreign_python_includes)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(directories)
      list(FILTER directories EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${directories}")
    endif()
  endforeach()
endfunction()

cmake_language(DEFER CALL _drop_foreign_python_includes)
