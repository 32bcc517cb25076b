#include "overlay.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gl_api.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-braces"
#include <stb_easy_font.h>
#pragma GCC diagnostic pop

enum { MAX_IMAGES = 4, MAX_RUNS = 2 * MAX_IMAGES + 1, MAX_TEXT_QUADS = 4096 };

typedef struct {
  float x, y, u, v;
  overlay_colour colour;
} overlay_vertex;

/* Vertices that are drawn with one texture. */
typedef struct {
  GLuint texture;
  GLsizei vertex_count;
} run;

struct overlay {
  GLuint program, vertex_array, buffer, white, images[MAX_IMAGES];
  GLint size_uniform;
  int width_px, height_px, image_count, run_count;
  float scale;
  run runs[MAX_RUNS];
  overlay_vertex *vertices;
  size_t vertex_count, vertex_capacity;
};

static const char vertex_shader[] =
    "#version 330 core\n"
    "layout(location = 0) in vec2 position;\n"
    "layout(location = 1) in vec2 uv;\n"
    "layout(location = 2) in vec4 paint;\n"
    "uniform vec4 size;\n"
    "out vec2 texel;\n"
    "out vec4 tint;\n"
    "void main() {\n"
    "  texel = uv;\n"
    "  tint = paint;\n"
    "  gl_Position = vec4(position * size.xy + size.zw, 0.0, 1.0);\n"
    "}\n";
static const char fragment_shader[] = "#version 330 core\n"
                                      "uniform sampler2D image;\n"
                                      "in vec2 texel;\n"
                                      "in vec4 tint;\n"
                                      "out vec4 colour;\n"
                                      "void main() { colour = tint * texture(image, texel); }\n";

static GLuint create_image(void) {
  GLuint texture;
  gl.GenTextures(1, &texture);
  gl.BindTexture(GL_TEXTURE_2D, texture);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
  return texture;
}

slf_result overlay_create(overlay **out, slf_error *error) {
  *out = NULL;
  overlay *o = calloc(1, sizeof *o);
  if (!o) {
    snprintf(error->message, sizeof error->message, "out of memory");
    return SLF_ERROR_MEMORY;
  }
  slf_result result = gl_link_program(vertex_shader, fragment_shader, &o->program, error);
  if (result != SLF_OK) {
    free(o);
    return result;
  }
  o->size_uniform = gl.GetUniformLocation(o->program, "size");
  static const uint8_t white[4] = {255, 255, 255, 255};
  o->white = create_image();
  gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, 1, 1, 0, GL_RGBA, GL_UNSIGNED_BYTE, white);
  for (int i = 0; i < MAX_IMAGES; i++) o->images[i] = create_image();
  gl.GenVertexArrays(1, &o->vertex_array);
  gl.BindVertexArray(o->vertex_array);
  gl.GenBuffers(1, &o->buffer);
  gl.BindBuffer(GL_ARRAY_BUFFER, o->buffer);
  for (GLuint i = 0; i < 3; i++) gl.EnableVertexAttribArray(i);
  gl.VertexAttribPointer(0, 2, GL_FLOAT, GL_FALSE, sizeof(overlay_vertex),
                         (const void *)offsetof(overlay_vertex, x));
  gl.VertexAttribPointer(1, 2, GL_FLOAT, GL_FALSE, sizeof(overlay_vertex),
                         (const void *)offsetof(overlay_vertex, u));
  gl.VertexAttribPointer(2, 4, GL_UNSIGNED_BYTE, GL_TRUE, sizeof(overlay_vertex),
                         (const void *)offsetof(overlay_vertex, colour));
  *out = o;
  return SLF_OK;
}

void overlay_free(overlay *o) {
  if (!o) return;
  gl.DeleteProgram(o->program);
  gl.DeleteTextures(1, &o->white);
  gl.DeleteTextures(MAX_IMAGES, o->images);
  gl.DeleteVertexArrays(1, &o->vertex_array);
  gl.DeleteBuffers(1, &o->buffer);
  free(o->vertices);
  free(o);
}

void overlay_begin(overlay *o, int width_px, int height_px, float scale) {
  o->width_px = width_px;
  o->height_px = height_px;
  o->scale = scale;
  o->image_count = o->run_count = 0;
  o->vertex_count = 0;
}

/* Two triangles; a quad that does not fit into memory is left out. */
static void add_quad(overlay *o, GLuint texture, const overlay_vertex quad[4]) {
  static const int corners[6] = {0, 1, 2, 0, 2, 3};
  if (o->vertex_count + 6 > o->vertex_capacity) {
    size_t capacity = 2 * o->vertex_capacity + 6000;
    overlay_vertex *moved = realloc(o->vertices, capacity * sizeof *moved);
    if (!moved) return;
    o->vertices = moved;
    o->vertex_capacity = capacity;
  }
  if (o->run_count == 0 || o->runs[o->run_count - 1].texture != texture) {
    if (o->run_count == MAX_RUNS) return;
    o->runs[o->run_count++] = (run){.texture = texture};
  }
  for (int i = 0; i < 6; i++) o->vertices[o->vertex_count++] = quad[corners[i]];
  o->runs[o->run_count - 1].vertex_count += 6;
}

static void add_rectangle(overlay *o, GLuint texture, float x, float y, float width, float height,
                          float u0, float u1, overlay_colour colour) {
  add_quad(o, texture,
           (overlay_vertex[4]){{x, y, u0, 0, colour},
                               {x + width, y, u1, 0, colour},
                               {x + width, y + height, u1, 1, colour},
                               {x, y + height, u0, 1, colour}});
}

void overlay_box(overlay *o, float x, float y, float width, float height, overlay_colour colour) {
  add_rectangle(o, o->white, x, y, width, height, 0, 1, colour);
}

float overlay_text_width(const overlay *o, const char *text) {
  return o->scale * (float)stb_easy_font_width((char *)(uintptr_t)text);
}

float overlay_line_height(const overlay *o) {
  return 12 * o->scale;
}

void overlay_text(overlay *o, float x, float y, overlay_colour colour, const char *text) {
  static struct {
    float x, y, z;
    uint8_t colour[4];
  } quads[4 * MAX_TEXT_QUADS];
  int count = stb_easy_font_print(0, 0, (char *)(uintptr_t)text, NULL, quads, sizeof quads);
  for (int i = 0; i < count; i++) {
    overlay_vertex corners[4];
    for (int k = 0; k < 4; k++)
      corners[k] = (overlay_vertex){x + quads[4 * i + k].x * o->scale,
                                    y + quads[4 * i + k].y * o->scale, 0, 0, colour};
    add_quad(o, o->white, corners);
  }
}

float overlay_panel(overlay *o, float x, float y, const char *text) {
  int lines = 1;
  for (const char *c = text; *c; c++) lines += *c == '\n';
  float margin = 6 * o->scale, width = overlay_text_width(o, text) + 2 * margin;
  float height = (float)lines * overlay_line_height(o) + 2 * margin - 3 * o->scale;
  overlay_box(o, x, y, width, height, (overlay_colour){0, 0, 0, 176});
  overlay_text(o, x + margin, y + margin, (overlay_colour){255, 255, 255, 255}, text);
  return height;
}

void overlay_image(overlay *o, float x, float y, float width, float height, const uint8_t *rgba,
                   int image_width, int image_height, float left_fraction, float right_fraction) {
  if (o->image_count == MAX_IMAGES) return;
  GLuint texture = o->images[o->image_count++];
  gl.BindTexture(GL_TEXTURE_2D, texture);
  gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, image_width, image_height, 0, GL_RGBA, GL_UNSIGNED_BYTE,
                rgba);
  add_rectangle(o, texture, x + width * left_fraction, y, width * (right_fraction - left_fraction),
                height, left_fraction, right_fraction, (overlay_colour){255, 255, 255, 255});
}

void overlay_finish(overlay *o) {
  gl.Disable(GL_FRAMEBUFFER_SRGB); /* colours are display codes already */
  gl.Disable(GL_DEPTH_TEST);
  gl.Disable(GL_CULL_FACE);
  gl.Enable(GL_BLEND);
  gl.BlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
  gl.UseProgram(o->program);
  gl.Uniform4f(o->size_uniform, 2 / (float)o->width_px, -2 / (float)o->height_px, -1, 1);
  gl.BindVertexArray(o->vertex_array);
  gl.BindBuffer(GL_ARRAY_BUFFER, o->buffer);
  gl.BufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(o->vertex_count * sizeof *o->vertices), o->vertices,
                GL_DYNAMIC_DRAW);
  GLint first = 0;
  for (int i = 0; i < o->run_count; i++) {
    gl.BindTexture(GL_TEXTURE_2D, o->runs[i].texture);
    gl.DrawArrays(GL_TRIANGLES, first, o->runs[i].vertex_count);
    first += o->runs[i].vertex_count;
  }
  gl.Disable(GL_BLEND);
}
