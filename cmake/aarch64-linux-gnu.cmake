# Toolchain of arm64 (aarch64) Linux for an x86 computer with Debian's cross-compiler; what is built runs under qemu here. Without KINCAL_SYSROOT
# only headers are taken from this computer, which is all that the library core needs (Eigen, and Catch2 for its tests); with it everything is
# taken from that folder, a Debian of arm64 (scripts/cross-arm64 makes one).
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES KINCAL_SYSROOT)

set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
if(KINCAL_SYSROOT)
  set(CMAKE_SYSROOT ${KINCAL_SYSROOT})
  set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
  set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
  set(ENV{PKG_CONFIG_SYSROOT_DIR} ${KINCAL_SYSROOT})
  set(ENV{PKG_CONFIG_LIBDIR} ${KINCAL_SYSROOT}/usr/lib/aarch64-linux-gnu/pkgconfig:${KINCAL_SYSROOT}/usr/share/pkgconfig)
  set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64-static -L ${KINCAL_SYSROOT})
else()
  set(CMAKE_FIND_ROOT_PATH /usr/aarch64-linux-gnu)
  set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64-static -L /usr/aarch64-linux-gnu)
endif()
