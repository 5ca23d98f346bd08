export async function compareRoom(place) { place.append(document.createTextNode("compare")); }
