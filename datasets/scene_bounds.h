/* scene_bounds.h: ground and bounds of a scene from its pictures. Internal to datasets/scene_set.c.
 */
#ifndef LF_DATASETS_SCENE_BOUNDS_H
#define LF_DATASETS_SCENE_BOUNDS_H

#include "datasets/scene_set.h"

/* entry->white: of a few training views one is transparent somewhere, or every one has a white rim.
 */
lf_status lf_entry_find_ground(lf_scene_entry *entry, lf_error *err);
/* entry->centre and radius by what no outline rules out, within a cube between the cameras; they
 * stay if nothing or almost everything is left. */
lf_status lf_entry_find_bounds(lf_scene_entry *entry, lf_error *err);

#endif
