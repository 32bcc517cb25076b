VIEWER_CORE_OBJECTS += $(OBJ)/viewer/ripple.o
